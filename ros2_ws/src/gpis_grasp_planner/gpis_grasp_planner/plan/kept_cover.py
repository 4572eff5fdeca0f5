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
    """

    def __init__(self, settings: CacheSettings, mesh: TriangleMesh, tolerance: float):
        self._disk = DiskCache.of(settings)
        self._key = repr((mesh.content_hash, tolerance, code_version(*_SOURCES)))

    def load_into(self, cover: ConvexCover) -> bool:
        """Complete a cover from the disk; whether there was one. Some ms."""
        if cover.is_complete():
            return True
        arrays = self._disk.get(_KIND, self._key)
        if arrays is None:
            return False
        cover.take_arrays(arrays)
        return True

    def save(self, cover: ConvexCover) -> None:
        """Keep a complete cover; what cannot be written is left."""
        self._disk.put(_KIND, self._key, cover.as_arrays())
