"""Where to look from: a camera that frames a scene, and the direction that shows a grasp best."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpis_grasp_planner.geometry.transforms import transform
from gpis_grasp_planner.view.renderer import Camera, Scene

Array = NDArray[np.float64]

# Directions from the scene to the camera.
VIEWS = {
    "front": np.array([0.15, -1.0, 0.25]),
    "back": np.array([-0.15, 1.0, 0.25]),
    "left": np.array([-1.0, -0.15, 0.25]),
    "right": np.array([1.0, 0.15, 0.25]),
    "top": np.array([0.05, -0.25, 1.0]),
    "iso": np.array([1.0, -1.0, 0.7]),
}

_MARGIN = 1.06
_FOV_DEG = 28.0
_LOOK_HEIGHT = 96  # pixels


def look_from(direction: ArrayLike, points: Array, aspect: float) -> Camera:
    """Camera on the side `direction` (3,) of `points` (n, 3) [m] that just frames them all.

    The scene's z axis points up in the picture, y where the camera looks along z.
    """
    back = np.asarray(direction, dtype=float)
    back = back / np.linalg.norm(back)
    up = np.array([0.0, 0.0, 1.0]) if abs(back[2]) < 0.98 else np.array([0.0, 1.0, 0.0])
    right = np.cross(up, back)
    right /= np.linalg.norm(right)
    R = np.column_stack([right, np.cross(back, right), back])
    local = points @ R
    slope = np.tan(np.radians(_FOV_DEG) / 2.0) / _MARGIN
    # A point is in the picture if |x| <= aspect slope (z_camera - z), and the same for y without
    # the aspect: each side gives a bound that two opposite sides meet in the middle.
    center = np.empty(3)
    distance = []
    for axis, side in ((0, aspect * slope), (1, slope)):
        high = np.max(local[:, axis] + side * local[:, 2])
        low = np.max(-local[:, axis] + side * local[:, 2])
        center[axis] = (high - low) / 2.0
        distance.append((high + low) / (2.0 * side))
    center[2] = max(distance)
    return Camera(transform(R, R @ center), _FOV_DEG)


def best_view(
    scene: Scene,
    n_part: int,
    n_solid: int,
    n_contacts: int,
    points: Array,
    aspect: float,
    *,
    from_below: bool = True,
) -> Camera:
    """The camera, of a ring of directions, that shows most of part, hand and contacts.

    Parameters
    ----------
    scene : Scene
        Its first `n_part` bodies are the part, those up to `n_solid` the hand, and `n_contacts`
        balls at the contacts come next. What comes after these is in the way alone. No markers.
    points : (n, 3) array [m]
        What must be in the picture.
    aspect : float
        Width over height.
    from_below : bool
        Whether it may be; not where there is a table.
    """
    width, height = round(_LOOK_HEIGHT * aspect), _LOOK_HEIGHT
    best_score, best_camera = -np.inf, look_from(VIEWS["iso"], points, aspect)
    for elevation_deg in (*((-15.0,) if from_below else ()), 15.0, 32.0, 48.0):
        for azimuth in np.radians(np.arange(0.0, 360.0, 22.5) - 60.0):
            z = np.sin(np.radians(elevation_deg))
            flat = np.sqrt(1.0 - z * z)
            direction = (flat * np.cos(azimuth), flat * np.sin(azimuth), z)
            camera = look_from(direction, points, aspect)
            body = scene.coverage(camera, width, height)
            part = np.count_nonzero((body >= 0) & (body < n_part)) / body.size
            of_hand = body[(body >= n_part) & (body < n_solid)]
            pieces = np.unique(of_hand, return_counts=True)[1]
            hand = np.minimum(pieces / body.size, 0.015).sum()  # many pieces, not one large
            score = hand * (np.sqrt(part) if n_part else 1.0)
            if n_contacts:
                balls = body[(body >= n_solid) & (body < n_solid + n_contacts)]
                score *= 0.5 + len(np.unique(balls)) / n_contacts
            if not 0.0 < elevation_deg < 40.0:
                score *= 0.85  # people look at things from above, and not from far above
            if score > best_score:
                best_score, best_camera = score, camera
    return best_camera
