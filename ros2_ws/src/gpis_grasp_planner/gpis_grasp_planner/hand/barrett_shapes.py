"""Link shapes of the BarrettHand BH8-280 as convex pieces, drawn from its measured dimensions.

Every piece is the hull of a few rings of points. Numbers are millimetres in the link's own
frame, as the dimensions are quoted; :func:`barrett_pieces` returns metres. Where a dimension is
not known, the choice is commented.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.hand.link_mesh import convex_hull
from gpis_grasp_planner.hand.outlines import arc, bar, crown

Array = NDArray[np.float64]

SPREAD_AXIS_OFFSET_MM = 25.0
SPREAD_FRAME_HEIGHT_MM = 41.5
INNER_AXIS_MM = (50.0, 33.9)  # (along the finger, up) in the knuckle frame
DISTAL_AXIS_MM = (69.936, 3.0)  # in the inner link's frame
DISTAL_ANGLE_DEG = 40.0

PALM_RADIUS_MM = 44.5
PLATE_BOTTOM_MM, PLATE_TOP_MM = 66.3, 79.3
KNUCKLE_HALF_WIDTH_MM = 12.3
KNUCKLE_TOP_RADIUS_MM = 15.0  # about the inner axis: gives the top 48.9 and the front 65
INNER_WIDTH_MM, DISTAL_WIDTH_MM = 21.0, 23.0

PAD_CROWN_RADIUS_MM, PAD_APEX_MM = 96.7, (31.0, 11.0)
TIP_RADIUS_MM, TIP_CENTER_MM = 9.56, (47.98, -0.18)
# The nail ends at x = 59; that the open hand spans 334.6 nail to nail puts its corner here.
NAIL_CORNER_MM = (59.0, -3.372)


def _upright(points: Array) -> Array:
    """Turn (x, y, z) of a bar into (x, -z, y): its outline stands up on the finger's line."""
    return np.stack([points[:, 0], -points[:, 2], points[:, 1]], axis=1)


def palm_base() -> Array:
    """Cylinder of radius 44.5 from the mounting plane to z = 41.5."""
    ring = arc((0.0, 0.0), PALM_RADIUS_MM, 0.0, 348.75, 32)
    return np.vstack([np.insert(ring, 2, z, axis=1) for z in (0.0, SPREAD_FRAME_HEIGHT_MM)])


def palm_neck() -> Array:
    """Web between the two turning knuckles (12.7 mm off the centre plane), up to the plate."""
    half_width, back, front = 12.5, -26.0, 27.0
    corners = [(x, y) for x in (-half_width, half_width) for y in (back, front)]
    return np.array([(*c, z) for c in corners for z in (41.0, PLATE_BOTTOM_MM + 1.0)])


def plate_outline() -> Array:
    """Outline (n, 2) of the palm plate: x +-44.5, y -35..26.5.

    The knuckles' towers begin 35 mm from the spread axes and turn around the plate's corners, so
    the corners are arcs about these axes with half a millimetre of clearance.
    """
    clear = 2 * KNUCKLE_TOP_RADIUS_MM + 4.5
    start = np.degrees(np.arccos(-(PALM_RADIUS_MM - SPREAD_AXIS_OFFSET_MM) / clear))
    corner = arc((-SPREAD_AXIS_OFFSET_MM, 0.0), clear, 360.0 - start, 270.0, 6)
    left = np.vstack([corner, [(-10.0, -35.0)], arc((-36.5, 18.5), 8.0, 90.0, 180.0, 5)])
    return np.vstack([left, left * (-1.0, 1.0)])


def palm_plate() -> Array:
    """Palm plate, z 66.3..79.3, domed: its top falls by 2.5 mm from the middle to the rim.

    Its edge towards F1 and F2 is beveled so that their inner links clear it up to their 140 deg.
    """
    outline = plate_outline()
    rim_height = np.where(outline[:, 1] < -28.0, 68.5, 73.5)
    shoulder = np.column_stack([outline[:, 0] * 0.955, np.maximum(outline[:, 1] * 0.955, -26.0)])
    return np.vstack(
        [
            np.insert(outline, 2, PLATE_BOTTOM_MM, axis=1),
            np.column_stack([outline, rim_height]),
            np.insert(shoulder, 2, 76.8, axis=1),
            np.insert(outline * 0.62, 2, 78.2, axis=1),
            np.insert(outline * 0.3, 2, PLATE_TOP_MM, axis=1),
        ]
    )


def knuckle_hub() -> Array:
    """Turning body about the spread axis, below the palm plate."""
    half = KNUCKLE_HALF_WIDTH_MM
    outline = np.vstack([arc((0.0, 0.0), half, 90.0, 270.0, 13), [(40.0, -half), (40.0, half)]])
    top = PLATE_BOTTOM_MM - SPREAD_FRAME_HEIGHT_MM - 0.5
    return np.vstack([np.insert(outline, 2, z, axis=1) for z in (-5.0, top)])


def _tower_outline(back: float) -> Array:
    top = arc(INNER_AXIS_MM, KNUCKLE_TOP_RADIUS_MM, -10.0, 190.0, 17)
    # The outer lower edge is rounded on the hand; how far is not measured.
    foot = arc((57.0, 3.0), 8.0, 270.0, 360.0, 5)
    return np.vstack([top, foot, [(back, -5.0)]])


def knuckle_tower() -> Array:
    """Body that carries the inner joint: rises beside the plate to 48.9 over the frame."""
    return _upright(bar(_tower_outline(35.5), KNUCKLE_HALF_WIDTH_MM, 1.5))


def third_finger_block() -> Array:
    """F3's fixed block: the same tower, extended back to y = 27 below the plate's surface."""
    outline = np.vstack([_tower_outline(27.0), [(27.0, 33.0)]])
    return _upright(bar(outline, KNUCKLE_HALF_WIDTH_MM, 1.5))


def inner_link() -> Array:
    """Inner link: x -12.5..79.4, y -12.5..15.0, end radii 12.5 and 9.5, crowned inner side."""
    outline = np.vstack(
        [
            arc((0.0, 0.0), 12.5, 90.0, 270.0, 13),
            arc(DISTAL_AXIS_MM, 9.5, -90.0, 90.0, 11),
            # Where the crown culminates is a choice; this far out the link clears the palm.
            crown((44.0, 15.0), 150.0, 28.0, 60.0, 7),
        ]
    )
    return bar(outline, INNER_WIDTH_MM / 2, 1.5)


def distal_link() -> Array:
    """Distal link: crowned pad, tip circle and nail; x -9.5..59.0, 23 mm wide."""
    outline = np.vstack(
        [
            arc((0.0, 0.0), 9.5, 90.0, 270.0, 9),
            crown(PAD_APEX_MM, PAD_CROWN_RADIUS_MM, 18.0, 31.0, 4),
            crown(PAD_APEX_MM, PAD_CROWN_RADIUS_MM, 36.0, 49.84, 4),
            arc(TIP_CENTER_MM, TIP_RADIUS_MM, 65.0, -90.0, 11),
            [(59.0, -1.5), NAIL_CORNER_MM],
        ]
    )
    return bar(outline, DISTAL_WIDTH_MM / 2, 2.0)


def barrett_pieces() -> dict[str, tuple[tuple[str, TriangleMesh], ...]]:
    """Convex pieces [m] of each body: body name to (piece name, mesh) pairs.

    Bodies are ``palm``, ``knuckle``, ``block`` (F3's, in the frame of a knuckle), ``inner`` and
    ``distal``; the fingers share them.
    """
    bodies = {
        "palm": {"palm_base": palm_base(), "palm_neck": palm_neck(), "palm_plate": palm_plate()},
        "knuckle": {"knuckle_hub": knuckle_hub(), "knuckle_tower": knuckle_tower()},
        "block": {"third_finger_block": third_finger_block()},
        "inner": {"inner_link": inner_link()},
        "distal": {"distal_link": distal_link()},
    }
    return {
        body: tuple((name, convex_hull(points / 1000.0)) for name, points in pieces.items())
        for body, pieces in bodies.items()
    }
