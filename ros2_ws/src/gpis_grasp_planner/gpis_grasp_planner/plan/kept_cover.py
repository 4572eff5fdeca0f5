"""The convex cover of a part on disk: a part that was tried once is tried at once the next time."""

from __future__ import annotations

from gpis_grasp_planner.disk_cache import CacheSettings, DiskCache, code_version
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.verification.convex_cover import ConvexCover

_KIND = "cover"
_SOURCES = ("compiled.py", "geometry", "verification/convex_cover.py")


class KeptCover:
    """Reads and writes the cover of one mesh.

    Parameters
    ----------
    settings : CacheSettings
    mesh : TriangleMesh
    tolerance : float [m]
        Of the cover.
    field_spacing : float [m]
        Of the distance field by which pieces are judged.
    """

    def __init__(
        self, settings: CacheSettings, mesh: TriangleMesh, tolerance: float, field_spacing: float
    ):
        self._disk = DiskCache.of(settings)
        key = (mesh.content_hash, tolerance, field_spacing, code_version(*_SOURCES))
        self._key = repr(key)
        self._n_at_load = 0

    def load_into(self, cover: ConvexCover) -> None:
        """Take what the disk has of a cover, if it is more than there is. Some ms."""
        arrays = None if cover.is_complete() else self._disk.get(_KIND, self._key)
        if arrays is not None and int(arrays["covered"].sum()) > cover.n_covered:
            cover.take_arrays(arrays)
        self._n_at_load = cover.n_covered

    def save(self, cover: ConvexCover) -> None:
        """Keep a cover, whole or in part, that grew since it was loaded and is more than is kept.

        What cannot be written is left.
        """
        if cover.n_covered <= self._n_at_load:
            return
        kept = self._disk.get(_KIND, self._key)
        if kept is None or int(kept["covered"].sum()) < cover.n_covered:
            self._disk.put(_KIND, self._key, cover.as_arrays())
