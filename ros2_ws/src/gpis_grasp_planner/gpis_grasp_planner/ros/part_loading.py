"""Meshes are read in a short-lived child of the planning process.

The mesh library takes 45 MB that a process does not give back, and a file that crashes a parser
takes the process with it. A forked child shares all that the planning process has imported, reads
and judges the mesh, hands over the part and ends. The last few parts are kept while their files
stay the same, so that another plan of a mesh reads nothing.
"""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import signal
from collections import OrderedDict
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

from gpis_grasp_planner.errors import MeshError
from gpis_grasp_planner.geometry.catalogue import CatalogueSettings, MeshCatalogue
from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.ros.mesh_source import fingerprint

_KEPT_PARTS = 4
_PR_SET_PDEATHSIG = 1


class PartLoader:
    """Loads parts by mesh ID, and keeps the last few."""

    def __init__(self) -> None:
        self._parts: OrderedDict[tuple[object, ...], Part] = OrderedDict()

    def load(self, directories: Sequence[Path], settings: CatalogueSettings, mesh_id: str) -> Part:
        """Read the part of an ID, in a child unless it is known. About 0.5 s.

        Raises
        ------
        GraspPlannerError
            Of the catalogue; MESH_UNREADABLE where reading the file ended the child.
        """
        key = self._key(directories, settings, mesh_id)
        part = self._parts.pop(key, None) or load_apart(directories, settings, mesh_id)
        if self._key(directories, settings, mesh_id) == key:  # not replaced meanwhile
            self._parts[key] = part
        if len(self._parts) > _KEPT_PARTS:
            self._parts.popitem(last=False)
        return part

    @staticmethod
    def _key(
        directories: Sequence[Path], settings: CatalogueSettings, mesh_id: str
    ) -> tuple[object, ...]:
        source = fingerprint(directories, mesh_id, settings.max_file_bytes)
        return tuple(directories), settings, mesh_id, source


def load_apart(directories: Sequence[Path], settings: CatalogueSettings, mesh_id: str) -> Part:
    """Read the part of an ID in a forked child; see :meth:`PartLoader.load`."""
    fork = multiprocessing.get_context("fork")
    with ProcessPoolExecutor(1, fork, _end_with_parent, (os.getpid(),)) as child:
        try:
            return child.submit(_load, tuple(directories), settings, mesh_id).result()
        except BrokenProcessPool:
            raise MeshError(
                f"Reading the mesh '{mesh_id}' ended the process that read it (damaged, or too "
                "large for the memory). Export it again, or simplify it."
            ) from None


def _load(directories: tuple[Path, ...], settings: CatalogueSettings, mesh_id: str) -> Part:
    return MeshCatalogue(directories, settings).load(mesh_id)


def _end_with_parent(parent: int) -> None:
    # The child holds a copy of the socket to the node; should the planning process be killed, the
    # node is to see that at once and not when the mesh has been read.
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(1)
