"""Meshes are read in a short-lived child of the planning process.

The mesh library takes 45 MB that a process does not give back, and a file that crashes a parser
takes the process with it. A forked child shares all that the planning process has imported, reads
and judges the mesh, hands over the part and ends. The last few parts are kept while their files
stay the same, so that another plan of a mesh reads nothing.
"""

from __future__ import annotations

import time
import traceback
from collections import OrderedDict
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection
from pathlib import Path

from gpis_grasp_planner.errors import ErrorCode, GraspPlannerError, MeshError, PlanningError
from gpis_grasp_planner.forked_child import ForkedChild
from gpis_grasp_planner.geometry.catalogue import CatalogueSettings, MeshCatalogue
from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.ros.mesh_source import check_directories, fingerprint

_KEPT_PARTS = 4
READ_LIMIT_S = 60.0
_LOOK_S = 0.05


class PartLoader:
    """Loads parts by mesh ID, and keeps the last few."""

    def __init__(self) -> None:
        self._parts: OrderedDict[tuple[object, ...], Part] = OrderedDict()

    def load(
        self,
        directories: Sequence[Path],
        settings: CatalogueSettings,
        mesh_id: str,
        *,
        limit_s: float = READ_LIMIT_S,
        should_stop: Callable[[], bool] = lambda: False,
    ) -> Part:
        """Read the part of an ID, in a child unless it is known. About 0.5 s.

        Parameters
        ----------
        directories : sequence of Path
        settings : CatalogueSettings
        mesh_id : str
        limit_s : float [s]
            A child that takes longer is ended.
        should_stop : callable
            Asked some twenty times a second while the child reads; True ends it.

        Raises
        ------
        GraspPlannerError
            Of the catalogue; MESH_UNREADABLE where reading the file ended the child or took too
            long; CANCELLED.
        """
        key = self._key(directories, settings, mesh_id)
        part = self._parts.pop(key, None) or load_apart(
            directories, settings, mesh_id, limit_s, should_stop
        )
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


def load_apart(
    directories: Sequence[Path],
    settings: CatalogueSettings,
    mesh_id: str,
    limit_s: float = READ_LIMIT_S,
    should_stop: Callable[[], bool] = lambda: False,
) -> Part:
    """Read the part of an ID in a forked child; see :meth:`PartLoader.load`."""

    def serve(connection: Connection) -> None:
        connection.send(_outcome(directories, settings, mesh_id))

    end = time.monotonic() + limit_s
    with ForkedChild(serve) as child:
        try:
            while not child.connection.poll(_LOOK_S):
                if should_stop():
                    raise PlanningError(
                        f"Cancelled while the mesh '{mesh_id}' was read.", ErrorCode.CANCELLED
                    )
                if time.monotonic() > end:
                    raise MeshError(
                        f"Reading the mesh '{mesh_id}' was not done after {limit_s:g} s (parameter "
                        "mesh_read_limit_s) and was given up. Does the file's disk answer? "
                        "Simplify a file that is slow to read, or raise the limit."
                    )
            outcome: Part | Exception = child.connection.recv()
        except (EOFError, OSError):
            raise MeshError(
                f"Reading the mesh '{mesh_id}' ended the process that read it (damaged, or too "
                "large for the memory). Export it again, or simplify it."
            ) from None
    if isinstance(outcome, Exception):
        raise outcome
    return outcome


def _outcome(
    directories: Sequence[Path], settings: CatalogueSettings, mesh_id: str
) -> Part | Exception:
    try:
        check_directories(directories)
        return MeshCatalogue(directories, settings).load(mesh_id)
    except (GraspPlannerError, MemoryError) as error:
        return error
    except Exception as error:
        traceback.print_exc()  # it does not travel with the error
        return error
