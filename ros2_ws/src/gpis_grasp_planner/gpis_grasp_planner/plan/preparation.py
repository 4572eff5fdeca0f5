"""What is made once per mesh before anything can be searched: field, tree and surface."""

from __future__ import annotations

import threading
from collections import OrderedDict
from dataclasses import dataclass

from gpis_grasp_planner.geometry.distance_field import DistanceField
from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.geometry.triangle_tree import TriangleTree
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.surface.atlas import SurfaceAtlas
from gpis_grasp_planner.surface.implicit_surface import fit_part

_KEPT_OBJECTS = 4


@dataclass(frozen=True, eq=False)
class PreparedObject:
    """What is made once per mesh: distance field, triangle tree, and the atlas of the GPIS."""

    field: DistanceField
    tree: TriangleTree
    atlas: SurfaceAtlas


class Preparation:
    """Prepares parts; keeps what it made for the last few meshes.

    Parameters
    ----------
    settings : PlannerSettings
    """

    def __init__(self, settings: PlannerSettings):
        self.settings = settings
        self._prepared: OrderedDict[str, PreparedObject] = OrderedDict()
        self._lock = threading.Lock()

    def of(self, part: Part) -> PreparedObject:
        """Fit the surface and sample the distance field of a part (0.3 to 1.5 s), once.

        May be called from several threads.
        """
        key = part.mesh.content_hash
        with self._lock:
            prepared = self._prepared.get(key)
        # Made without the lock: who asks for another part that is known shall not wait.
        prepared = prepared or PreparedObject(
            field=DistanceField.of(part.mesh, cells=self.settings.scene.field_cells),
            tree=TriangleTree.of(part.mesh),
            atlas=SurfaceAtlas(fit_part(part.mesh, self.settings.surface)),
        )
        with self._lock:
            self._prepared[key] = prepared
            self._prepared.move_to_end(key)
            while len(self._prepared) > _KEPT_OBJECTS:
                self._prepared.popitem(last=False)
        return prepared
