"""What is made once per mesh before anything can be searched: field, tree and surface.

Made side by side on the cores there are, kept for the last few meshes, and on disk for the next
process. The caller's thread waits and looks after progress and end, so that no step of the work,
however long, is silent or cannot be ended.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

from numpy.typing import NDArray
from scipy.version import version as scipy_version

from gpis_grasp_planner.disk_cache import DiskCache, code_version
from gpis_grasp_planner.errors import ErrorCode, PlanningError
from gpis_grasp_planner.geometry.distance_field import DistanceField
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
_DRAW_WEIGHT = 0.2
# A simplified mesh is near enough to close hands on if it is no farther from the mesh than this
# share of the contact threshold.
_APART_SHARE = 0.5
_DRAW_CELLS = 48  # of the field of a surface that was drawn
_SOURCES = ("compiled.py", "geometry", "surface", "plan/preparation.py")

OnShare = Callable[[float], None]
ShouldStop = Callable[[], bool]


@dataclass(frozen=True, eq=False)
class PreparedObject:
    """What is made once per mesh: distance field, triangle tree, and the atlas of the GPIS.

    The tree is over all triangles; field and surface are those of a large mesh's simplified one.
    `coarse` is a tree over that one, where it is so near to the mesh that hands may be closed on
    it while a grasp is looked for (`plan.exact_closing`). `draws` are fields and trees of the
    surfaces that a scanned part may have; none for a mesh file.
    """

    field: DistanceField
    tree: TriangleTree
    atlas: SurfaceAtlas
    draws: tuple[tuple[DistanceField, TriangleTree], ...] = ()
    coarse: TriangleTree | None = None

    @property
    def for_search(self) -> PreparedObject:
        """With the tree that hands are closed on while a grasp is looked for."""
        return self if self.coarse is None else replace(self, tree=self.coarse)


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
        self._running: dict[str, _SideBySide] = {}
        self._lock = threading.Lock()

    def of(
        self,
        part: Part,
        on_share: OnShare | None = None,
        should_stop: ShouldStop | None = None,
        late: ShouldStop | None = None,
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
            Asked as often; True ends the preparation, if nobody else waits for it.
        late : callable, optional
            Asked as often; True ends the waiting, not the work: a mesh that is too large for one
            budget is ready for the next request.

        Raises
        ------
        PlanningError
            CANCELLED where `should_stop` ended it, DEADLINE_EXCEEDED where it is late; within
            some 50 ms.
        MeshError
            For a mesh to which no surface can be fitted.
        """
        key = _key(part)
        with self._lock:
            prepared = self._prepared.get(key)
        # Made without the lock: who asks for another part that is known shall not wait.
        prepared = prepared or self._from_disk(key)
        if prepared is None:
            work = self._work(part)
            try:
                prepared = work.wait(on_share, should_stop, late)
            finally:
                with self._lock:
                    if work.over and self._running.get(key) is work:
                        del self._running[key]
        with self._lock:
            self._prepared[key] = prepared
            self._prepared.move_to_end(key)
            while len(self._prepared) > _KEPT_OBJECTS:
                self._prepared.popitem(last=False)
        return prepared

    def _work(self, part: Part) -> _SideBySide:
        """The work on a mesh, begun now unless it is under way."""
        key = _key(part)
        with self._lock:
            work = self._running.get(key)
            if work is None or work.failed:
                work = self._running[key] = self._begun(part)
            work.n_waiting += 1
            return work

    def _from_disk(self, key: str) -> PreparedObject | None:
        arrays = self.disk.get(_KIND, self._disk_key(key))
        if arrays is None:
            return None
        surface = ImplicitSurface.from_arrays(_of_group("surface", arrays), self.settings.surface)
        return PreparedObject(
            _field(_of_group("field", arrays)),
            TriangleTree(**_of_group("tree", arrays)),
            SurfaceAtlas(surface),
            tuple(_drawn(k, arrays) for k in range(_n_drawn(arrays))),
            _coarse(arrays),
        )

    def _begun(self, part: Part) -> _SideBySide:
        mesh = part.working_mesh
        cells, surface_settings = self.settings.scene.field_cells, self.settings.surface
        drawn = () if part.uncertainty is None else part.uncertainty.draws
        work = _SideBySide(_WEIGHTS | {f"draw{k}": _DRAW_WEIGHT for k in range(len(drawn))})

        scene = self.settings.scene
        near = part.simplified_apart_m <= _APART_SHARE * scene.contact_threshold_m
        has_coarse = part.simplified is not None and near

        def field_and_trees() -> tuple[DistanceField, TriangleTree, TriangleTree | None]:
            field = DistanceField.of(mesh, cells=cells, on_share=work.reporter("field"))
            tree = TriangleTree.of(part.mesh, on_share=work.reporter("tree"))
            return field, tree, TriangleTree.of(mesh) if has_coarse else None

        def atlas() -> SurfaceAtlas:
            return SurfaceAtlas(fit_part(mesh, surface_settings, on_share=work.reporter("surface")))

        def draws() -> tuple[tuple[DistanceField, TriangleTree], ...]:
            made = []
            for k, other in enumerate(drawn):
                report = work.reporter(f"draw{k}")
                field = DistanceField.of(other, cells=min(cells, _DRAW_CELLS), on_share=report)
                made.append((field, TriangleTree.of(other)))
            return tuple(made)

        def joined(results: list[Any]) -> PreparedObject:
            (field, tree, coarse), made, others = results
            self.disk.put(
                _KIND,
                self._disk_key(_key(part)),
                {
                    **_named("field", field),
                    **_named("tree", tree),
                    **({} if coarse is None else _named("coarse", coarse)),
                    **{f"surface.{name}": a for name, a in made.surface.as_arrays().items()},
                    **{
                        f"{group}{k}.{f.name}": getattr(one, f.name)
                        for k, pair in enumerate(others)
                        for group, one in zip(("field", "tree"), pair, strict=True)
                        for f in fields(one)
                    },
                },
            )
            return PreparedObject(field, tree, made, others, coarse)

        work.begin([field_and_trees, atlas, draws], joined)
        return work

    def _disk_key(self, key: str) -> str:
        """Everything that what is made depends on."""
        return repr(
            (
                key,
                self.settings.scene.field_cells,
                self.settings.scene.contact_threshold_m,
                sorted(self.settings.surface.as_dict().items()),
                code_version(*_SOURCES),
                scipy_version,
            )
        )


class _Ended(Exception):  # no error: raised where nobody waits any more
    pass


class _SideBySide:
    """Functions in threads of their own, and a result joined of theirs that many may wait for."""

    def __init__(self, weights: Mapping[str, float]):
        self.n_waiting = 0
        self._weights, self._all = weights, sum(weights.values())
        self._shares = dict.fromkeys(weights, 0.0)
        self._ended = threading.Event()
        self._look = threading.Condition()
        self._result: Any = None
        self._error: BaseException | None = None
        self._done = False

    @property
    def over(self) -> bool:
        """Whether nothing more will come of it."""
        return self._done or self.failed

    @property
    def failed(self) -> bool:
        """Whether it was ended, or ended by an error."""
        return self._ended.is_set() or self._error is not None

    def reporter(self, name: str) -> OnShare:
        """What a part of the work calls with its share; ends it when nobody waits any more."""

        def report(share: float) -> None:
            if self._ended.is_set():
                raise _Ended
            self._shares[name] = share

        return report

    def begin(self, functions: list[Callable[[], Any]], joined: Callable[[list[Any]], Any]) -> None:
        """Start the functions; the last to end makes the result of what all returned."""
        results: list[Any] = [None] * len(functions)
        left = [len(functions)]

        def work(index: int) -> None:
            try:
                results[index] = functions[index]()
                with self._look:
                    left[0] -= 1
                    last = not left[0]
                if last and not self.failed:
                    self._result = joined(results)
                    self._done = True
            except BaseException as error:
                self._error = self._error or error
                self._ended.set()  # the others' work is for nothing
            with self._look:
                self._look.notify_all()

        for index in range(len(functions)):
            threading.Thread(target=work, args=(index,), daemon=True).start()

    def wait(
        self,
        on_share: OnShare | None,
        should_stop: ShouldStop | None,
        late: ShouldStop | None,
    ) -> Any:
        """The result; see :meth:`Preparation.of`."""
        try:
            while not self.over:
                with self._look:
                    if self._look.wait_for(lambda: self.over, _LOOK_S):
                        break
                if should_stop is not None and should_stop():
                    if self.n_waiting == 1:
                        self._ended.set()
                    raise PlanningError(
                        "Ended while the part was prepared, before a grasp was looked for.",
                        ErrorCode.CANCELLED,
                    )
                if late is not None and late():
                    raise PlanningError(
                        "The time budget ended while the part was prepared, before a grasp was "
                        "looked for. Ask again with more time; a node goes on preparing it.",
                        ErrorCode.DEADLINE_EXCEEDED,
                    )
                if on_share is not None:
                    done = sum(w * self._shares[name] for name, w in self._weights.items())
                    on_share(done / self._all)
        finally:
            self.n_waiting -= 1
        if self._error is not None:
            raise self._error
        if not self._done:
            raise PlanningError("The preparation was ended by another.", ErrorCode.CANCELLED)
        return self._result


def _key(part: Part) -> str:
    """The mesh, and where search works with a simplified one or with draws, those too."""
    meshes = [part.mesh, *([] if part.simplified is None else [part.simplified])]
    meshes += [] if part.uncertainty is None else part.uncertainty.draws
    return "-".join(mesh.content_hash for mesh in meshes)


def _n_drawn(arrays: Mapping[str, NDArray[Any]]) -> int:
    return sum(name.endswith(".spacing") for name in arrays) - 1  # without the mesh's own field


def _drawn(k: int, arrays: Mapping[str, NDArray[Any]]) -> tuple[DistanceField, TriangleTree]:
    field = _field(_of_group(f"field{k}", arrays))
    return field, TriangleTree(**_of_group(f"tree{k}", arrays))


def _named(group: str, made: DistanceField | TriangleTree) -> dict[str, Any]:
    return {f"{group}.{f.name}": getattr(made, f.name) for f in fields(made)}


def _coarse(arrays: Mapping[str, NDArray[Any]]) -> TriangleTree | None:
    of_tree = _of_group("coarse", arrays)
    return TriangleTree(**of_tree) if of_tree else None


def _field(arrays: Mapping[str, NDArray[Any]]) -> DistanceField:
    return DistanceField(arrays["values"], arrays["origin"], float(arrays["spacing"]))


def _of_group(group: str, arrays: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    prefix = group + "."
    return {n.removeprefix(prefix): a for n, a in arrays.items() if n.startswith(prefix)}
