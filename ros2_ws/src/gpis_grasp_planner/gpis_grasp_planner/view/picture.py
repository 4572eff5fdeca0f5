"""Pictures of the hand on the part, rendered offscreen to PNG.

The part is warm yellow, the hand dark steel with a near-black palm, contacts are red balls with
the inward normals as arrows. Balls and arrows also show faintly where something hides them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image

from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.transforms import apply
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.hand.kinematics import link_transforms
from gpis_grasp_planner.hand.link_mesh import convex_hull
from gpis_grasp_planner.quality.contacts import Contacts
from gpis_grasp_planner.view.camera import VIEWS, best_view, look_from
from gpis_grasp_planner.view.legend import with_caption
from gpis_grasp_planner.view.renderer import Body, Camera, Scene
from gpis_grasp_planner.view.shapes import ellipsoid

Array = NDArray[np.float64]
Pixels = NDArray[np.uint8]

OBJECT_COLOR = (0.93, 0.62, 0.22)
AROUND_COLOR = (0.72, 0.75, 0.72)
WAY_COLOR = (0.10, 0.60, 0.25)
CONTACT_COLOR = (0.86, 0.05, 0.07)
PALM_COLOR = (0.23, 0.24, 0.26)
LINK_COLORS = ((0.36, 0.38, 0.41), (0.52, 0.55, 0.59), (0.40, 0.47, 0.56))  # from the palm outwards
_BALL_CORNERS = 162


@dataclass(frozen=True, eq=False)
class GraspView:
    """What one picture shows: a part (or None), the hand in its frame and the contacts.

    `around` are meshes of surroundings in the part's frame, `approach` the way (3,) [m] of the palm
    to where it is.
    """

    mesh: TriangleMesh | None
    hand: HandDescription
    T_object_palm: Array
    joints: Array
    contacts: Contacts | None = None
    caption: str = ""
    around: tuple[TriangleMesh, ...] = ()
    approach: Array | None = None


def render_grasp(
    mesh: TriangleMesh | None,
    hand: HandDescription,
    T_object_palm: ArrayLike,
    joints: ArrayLike,
    contacts: Contacts | None = None,
    *,
    path: Path | None = None,
    view: str | ArrayLike = "auto",
    size: tuple[int, int] = (1000, 750),
    caption: str = "",
    around: Sequence[TriangleMesh] = (),
    approach: ArrayLike | None = None,
) -> Pixels:
    """Render the hand on a part.

    Parameters
    ----------
    mesh : TriangleMesh or None
        The part in its own frame; None shows the hand alone.
    hand : HandDescription
    T_object_palm : (4, 4) array
    joints : (J,) array [rad]
    contacts : Contacts, optional
        In the part's frame.
    path : Path, optional
        Where to write a PNG.
    view : str or (3,) array
        A name of ``camera.VIEWS``, a direction from the scene to the camera in the part's frame,
        or "auto": the direction from which most of hand, part and contacts is seen.
    size : (int, int)
        Width and height in pixels.
    caption : str
        Written below the picture's upper edge.
    around : sequence of TriangleMesh
        Surroundings in the part's frame; the camera does not frame them.
    approach : (3,) array [m], optional
        The palm's way to where it is, drawn as a green arrow.

    Returns
    -------
    pixels : (height, width, 3) uint8 array
        The same input gives the same pixels.

    Raises
    ------
    RequestError
        If the view has an unknown name.
    """
    grasp = GraspView(
        mesh,
        hand,
        np.asarray(T_object_palm, float),
        np.asarray(joints, float),
        contacts,
        caption,
        tuple(around),
        None if approach is None else np.asarray(approach, float),
    )
    pixels = _render(grasp, view, size)
    if path is not None:
        Image.fromarray(pixels).save(path)
    return pixels


def render_sheet(
    grasps: Sequence[GraspView],
    *,
    path: Path | None = None,
    columns: int = 3,
    view: str | ArrayLike = "auto",
    size: tuple[int, int] = (480, 360),
) -> Pixels:
    """Render several grasps as one sheet, row by row; `size` is that of each picture.

    Returns
    -------
    pixels : (rows * height, columns * width, 3) uint8 array
    """
    if not grasps:
        raise RequestError("A sheet of 0 grasps was asked for; it takes at least one.")
    columns = min(columns, len(grasps))
    width, height = size
    rows = -(-len(grasps) // columns)
    sheet = np.full((rows * height, columns * width, 3), 255, dtype=np.uint8)
    for index, grasp in enumerate(grasps):
        row, column = divmod(index, columns)
        sheet[row * height : (row + 1) * height - 2, column * width : (column + 1) * width - 2] = (
            _render(grasp, view, (width - 2, height - 2))
        )
    if path is not None:
        Image.fromarray(sheet).save(path)
    return sheet


def hand_bodies(hand: HandDescription, T_object_palm: Array, joints: Array) -> list[Body]:
    """The hand's pieces as coloured bodies in the part's frame."""
    bodies = []
    for link, T_palm_link in enumerate(link_transforms(hand, joints)[0]):
        depth, ancestor = -1, link
        while (ancestor := int(hand.link_parent[ancestor])) >= 0:
            depth += 1
        palm_like = hand.link_friction_group[link] == "palm"
        color = PALM_COLOR if palm_like else LINK_COLORS[min(depth, len(LINK_COLORS) - 1)]
        T_object_link = T_object_palm @ T_palm_link
        for piece in hand.link_collision[link]:
            vertices = apply(T_object_link, piece.vertices)
            bodies.append(Body(TriangleMesh(vertices, piece.faces), color))
    return bodies


def _render(grasp: GraspView, view: str | ArrayLike, size: tuple[int, int]) -> Pixels:
    part = [] if grasp.mesh is None else [Body(grasp.mesh, OBJECT_COLOR)]
    solid = part + hand_bodies(grasp.hand, grasp.T_object_palm, grasp.joints)
    around = [Body(mesh, AROUND_COLOR) for mesh in grasp.around]
    contacts = Contacts.none() if grasp.contacts is None else grasp.contacts
    points = np.vstack([body.mesh.vertices for body in solid])
    diagonal = float(np.linalg.norm(np.ptp(points, axis=0)))
    markers = _contact_markers(contacts, diagonal)
    if grasp.approach is not None:
        way = _way(grasp.T_object_palm[:3, 3], grasp.approach, 0.006 * diagonal)
        markers += [Body(piece, WAY_COLOR, True) for piece in way]
        points = np.vstack([points, *(piece.vertices for piece in way)])
    camera = _camera(solid, len(part), around, contacts, points, view, size)
    with Scene(solid + around + markers) as scene:
        pixels = scene.render(camera, *size)
    return with_caption(pixels, grasp.caption) if grasp.caption else pixels


def _camera(
    solid: list[Body],
    n_part: int,
    around: list[Body],
    contacts: Contacts,
    points: Array,
    view: str | ArrayLike,
    size: tuple[int, int],
) -> Camera:
    aspect = size[0] / size[1]
    if isinstance(view, str) and view == "auto":
        radius = 0.012 * float(np.linalg.norm(np.ptp(points, axis=0)))
        balls = [
            Body(ellipsoid(position, np.full(3, radius), _BALL_CORNERS), CONTACT_COLOR)
            for position in contacts.positions
        ]
        with Scene(solid + balls + around) as scene:
            counts = n_part, len(solid), len(balls)
            return best_view(scene, *counts, points, aspect, from_below=not around)
    if isinstance(view, str) and view not in VIEWS:
        raise RequestError(f"View is '{view}'; choose auto, {', '.join(VIEWS)} or a direction.")
    direction = VIEWS[view] if isinstance(view, str) else np.asarray(view, dtype=float)
    return look_from(direction, points, aspect)


def _way(palm: Array, approach: Array, radius: float) -> list[TriangleMesh]:
    """An arrow that ends at the palm's origin."""
    length = float(np.linalg.norm(approach))
    return _arrow(palm - approach, approach / length, length, radius) if length else []


def _contact_markers(contacts: Contacts, diagonal: float) -> list[Body]:
    radius = 0.0085 * diagonal
    ball = ellipsoid(np.zeros(3), np.full(3, radius), _BALL_CORNERS)
    bodies = []
    for position, normal in zip(contacts.positions, contacts.normals_inward, strict=True):
        bodies.append(Body(TriangleMesh(ball.vertices + position, ball.faces), CONTACT_COLOR, True))
        arrow = _arrow(position, normal, 8.0 * radius, 0.3 * radius)
        bodies += [Body(part, CONTACT_COLOR, True) for part in arrow]
    return bodies


def _arrow(start: Array, direction: Array, length: float, radius: float) -> list[TriangleMesh]:
    side = np.linalg.svd(direction[None])[2][1:]
    angle = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
    ring = np.column_stack([np.cos(angle), np.sin(angle)]) @ side
    neck, tip = start + 0.72 * length * direction, start + length * direction
    shaft = convex_hull(np.vstack([start + radius * ring, neck + radius * ring]))
    return [shaft, convex_hull(np.vstack([neck + 2.6 * radius * ring, tip]))]
