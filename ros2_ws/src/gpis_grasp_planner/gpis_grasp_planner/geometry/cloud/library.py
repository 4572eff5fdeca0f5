"""Open3D, which is asked for clouds alone: an optional extra, loaded at the first use."""

from __future__ import annotations

from typing import Any

from gpis_grasp_planner.errors import ErrorCode, MeshError
from gpis_grasp_planner.extras import how_to_install


def open3d() -> Any:
    """Open3D's module; the first time this takes 0.9 s and 100 MB.

    Raises
    ------
    MeshError
        MESH_FORMAT_NOT_SUPPORTED where it is not installed.
    """
    try:
        import open3d as library
    except ImportError as error:
        raise MeshError(
            how_to_install("A point cloud", "Open3D", "cloud"),
            ErrorCode.MESH_FORMAT_NOT_SUPPORTED,
        ) from error
    return library
