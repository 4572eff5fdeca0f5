"""What is made once per mesh before anything can be searched: field, tree and surface.

Made side by side on the cores there are, kept for the last few meshes, and on disk for the next
process. The caller's thread waits and looks after progress and end, so that no step of the work,
however long, is silent or cannot be ended.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import Any

from numpy.typing import NDArray
from scipy.version import version as scipy_version

from gpis_grasp_planner.disk_cache import DiskCache, code_version
from gpis_grasp_planner.errors import ErrorCode, PlanningError
from gpis_grasp_planner.geometry.distance_field import DistanceField
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.geometry.triangle_tree import TriangleTree
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.surface.atlas import SurfaceAtlas
from gpis_grasp_planner.surface.implicit_surface import ImplicitSurface, fit_part

_KEPT_OBJECTS = 4
_LOOK_S = 0.02
_KIND = "object"
# Of the processor time, by part; for the progress.
_WEIGHTS = {"surface": 0.6, "field": 0.28, "tree": 0.12}
_SOURCES = ("compiled.py", "geometry", "surface", "plan/preparation.py")

OnShare = Callable[[float], None]
ShouldStop = Callable[[], bool]


@dataclass(frozen=True, eq=False)
class PreparedObject:
    """What is made once per mesh: distance field, triangle tree, and the atlas of the GPIS."""

    field: DistanceField
    tree: TriangleTree
    atlas: SurfaceAtlas


class Preparation:
    """Prepares parts; keeps what it made for the last few meshes, and on disk.

    Parameters
    ----------
    settings : PlannerSettings
        Of the groups scene, surface and cache.
    """

    def __init__(self, settings: PlannerSettings):
        self.settings = settings
        self.disk = DiskCache.of(settings.cache)
        self._prepared: OrderedDict[str, PreparedObject] = OrderedDict()
        self._lock = threading.Lock()

    def of(
        self,
        part: Part,
        on_share: OnShare | None = None,
        should_stop: ShouldStop | None = None,
    ) -> PreparedObject:
        """Fit the surface and sample the distance field of a part, once.

        For 5,500 triangles 0.4 s on two cores, 0.7 s on one, 20 ms from the disk. May be called
        from several threads.

        Parameters
        ----------
        part : Part
        on_share : callable, optional
            Called some fifty times a second with the share that is done, from 0 to 1.
        should_stop : callable, optional
            Asked as often; True ends the preparation.

        Raises
        ------
        PlanningError
            CANCELLED where `should_stop` ended it; within some 50 ms.
        MeshError
            For a mesh to which no surface can be fitted.
        """
        key = part.mesh.content_hash
        with self._lock:
            prepared = self._prepared.get(key)
        # Made without the lock: who asks for another part that is known shall not wait.
        prepared = prepared or self._from_disk(key) or self._made(part.mesh, on_share, should_stop)
        with self._lock:
            self._prepared[key] = prepared
            self._prepared.move_to_end(key)
            while len(self._prepared) > _KEPT_OBJECTS:
                self._prepared.popitem(last=False)
        return prepared

    def _from_disk(self, content_hash: str) -> PreparedObject | None:
        arrays = self.disk.get(_KIND, self._disk_key(content_hash))
        if arrays is None:
            return None
        surface = ImplicitSurface.from_arrays(_of_group("surface", arrays), self.settings.surface)
        field = _of_group("field", arrays)
        return PreparedObject(
            DistanceField(field["values"], field["origin"], float(field["spacing"])),
            TriangleTree(**_of_group("tree", arrays)),
            SurfaceAtlas(surface),
        )

    def _made(
        self, mesh: TriangleMesh, on_share: OnShare | None, should_stop: ShouldStop | None
    ) -> PreparedObject:
        cells, surface_settings = self.settings.scene.field_cells, self.settings.surface
        work = _SideBySide(_WEIGHTS)

        def field_and_tree() -> tuple[DistanceField, TriangleTree]:
            field = DistanceField.of(mesh, cells=cells, on_share=work.reporter("field"))
            return field, TriangleTree.of(mesh, on_share=work.reporter("tree"))

        def atlas() -> SurfaceAtlas:
            return SurfaceAtlas(fit_part(mesh, surface_settings, on_share=work.reporter("surface")))

        (field, tree), made = work.run([field_and_tree, atlas], on_share, should_stop)
        self.disk.put(
            _KIND,
            self._disk_key(mesh.content_hash),
            {
                **{f"field.{f.name}": getattr(field, f.name) for f in fields(field)},
                **{f"tree.{f.name}": getattr(tree, f.name) for f in fields(tree)},
                **{f"surface.{name}": a for name, a in made.surface.as_arrays().items()},
            },
        )
        return PreparedObject(field, tree, made)

    def _disk_key(self, content_hash: str) -> str:
        """Everything that what is made depends on."""
        return repr(
            (
                content_hash,
                self.settings.scene.field_cells,
                sorted(self.settings.surface.as_dict().items()),
                code_version(*_SOURCES),
                scipy_version,
            )
        )


class _Ended(Exception):  # no error: raised where nobody waits any more
    pass


class _SideBySide:
    """Functions in threads of their own, while the caller's looks after progress and end."""

    def __init__(self, weights: Mapping[str, float]):
        self._weights = weights
        self._shares = dict.fromkeys(weights, 0.0)
        self._ended = threading.Event()
        self._look = threading.Condition()

    def reporter(self, name: str) -> OnShare:
        """What a part of the work calls with its share; ends it when nobody waits any more."""

        def report(share: float) -> None:
            if self._ended.is_set():
                raise _Ended
            self._shares[name] = share

        return report

    def run(
        self,
        functions: list[Callable[[], Any]],
        on_share: OnShare | None,
        should_stop: ShouldStop | None,
    ) -> list[Any]:
        """Results of the functions; the first exception of any is raised."""
        results: list[Any] = [None] * len(functions)
        errors: list[BaseException] = []
        left = [len(functions)]

        def work(index: int) -> None:
            try:
                results[index] = functions[index]()
            except BaseException as error:
                errors.append(error)
            with self._look:
                left[0] -= 1
                self._look.notify()

        for index in range(len(functions)):
            threading.Thread(target=work, args=(index,), daemon=True).start()
        try:
            while True:
                with self._look:
                    if left[0] and not errors:
                        self._look.wait(_LOOK_S)
                    done = not left[0] or bool(errors)
                if done:
                    break
                if should_stop is not None and should_stop():
                    raise PlanningError(
                        "Ended while the part was prepared, before a grasp was looked for.",
                        ErrorCode.CANCELLED,
                    )
                if on_share is not None:
                    on_share(sum(w * self._shares[name] for name, w in self._weights.items()))
        finally:
            self._ended.set()
        if errors:
            raise errors[0]
        return results


def _of_group(group: str, arrays: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    prefix = group + "."
    return {n.removeprefix(prefix): a for n, a in arrays.items() if n.startswith(prefix)}
