"""Settings of everything that reads mesh files: limits, the default unit, the default density."""

from __future__ import annotations

from dataclasses import dataclass

from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.settings import SettingsGroup, setting


@dataclass(frozen=True)
class CatalogueSettings(SettingsGroup):
    """What a mesh file may be, and what is assumed where neither it nor its sidecar says."""

    default_unit: str = setting(
        "m",
        choices=("m", "cm", "mm", "um", "inch"),
        description="Unit of a mesh file that has no sidecar naming one; the answer says so.",
        common=True,
    )
    max_file_bytes: int = setting(
        600_000_000,
        low=1_000,
        high=2_000_000_000,
        description="Larger files are refused before they are read.",
    )
    max_faces: int = setting(
        2_000_000,
        low=100,
        high=10_000_000,
        description="Meshes with more triangles are refused, from the header where there is one.",
        common=True,
    )
    step_timeout_s: float = setting(
        60.0,
        low=1.0,
        high=3600.0,
        description="Time limit of the process that tessellates a STEP file.",
    )
    min_extent_m: float = setting(
        0.005,
        low=1e-6,
        high=10.0,
        description="A part whose largest extent is smaller is refused as a mistake of units.",
    )
    max_extent_m: float = setting(
        1.0,
        low=1e-3,
        high=1000.0,
        description="A part whose largest extent is larger is refused as a mistake of units.",
    )
    simplify_above_faces: int = setting(
        60_000,
        low=10_000,
        high=10_000_000,
        description="A mesh with more triangles is simplified for surface, field and physics; "
        "contacts are decided on the full mesh.",
    )
    degenerate_faces: str = setting(
        "drop",
        choices=("drop", "refuse"),
        description="Faces without area: drop them so that the surface stays closed and say so, "
        "or refuse the file.",
        common=True,
    )
    default_density_kg_m3: float = setting(
        1000.0,
        low=1.0,
        high=30_000.0,
        description="Density of a part whose sidecar gives neither mass, density nor material.",
        common=True,
    )

    cloud_noise_m: float = setting(
        0.0,
        low=0.0,
        high=0.05,
        description="Standard deviation of a point cloud's points across the surface; 0: estimated "
        "from the cloud.",
        common=True,
    )
    cloud_samples: int = setting(
        600,
        low=50,
        high=2000,
        description="Points and normals that the Gaussian process of a cloud is told; the time "
        "grows with the third power.",
    )
    cloud_cells: int = setting(
        56,
        low=16,
        high=160,
        description="Cells along the longest axis of the grid on which a cloud's surface is found.",
    )
    cloud_draws: int = setting(
        6,
        low=0,
        high=50,
        description="Surfaces drawn for a cloud, on which its grasps are judged (0.3 s each); 0: "
        "none.",
    )
    cloud_carving: bool = setting(
        True,
        description="Outside the silhouette that a viewpoint saw a cloud's part is absent. Switch "
        "off where a cloud is not all that was seen of the part.",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.min_extent_m > self.max_extent_m:
            raise RequestError(
                f"Setting 'min_extent_m' is {self.min_extent_m:g}, above 'max_extent_m' "
                f"{self.max_extent_m:g}: no part could be used. Lower the one or raise the other."
            )
