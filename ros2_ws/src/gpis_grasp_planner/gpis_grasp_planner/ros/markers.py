"""An answer for RViz: part, hand, contacts with normals, and the ways of the other grasps.

Each kind has a namespace, which RViz shows or hides by itself. Colours of hand, ways and text are
those of `ros.quality_color`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from xml.etree import ElementTree as ET

import numpy as np
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Point, Pose, Vector3
from numpy.typing import NDArray
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from gpis_grasp_msgs.msg import Grasp
from gpis_grasp_planner.geometry.transforms import (
    from_position_quat_xyzw,
    rotation_from_rpy,
    transform,
)
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.hand.kinematics import link_transforms
from gpis_grasp_planner.ros.conversions import pose_messages
from gpis_grasp_planner.ros.quality_color import quality_color, quality_text

PART_COLOR = ColorRGBA(r=0.93, g=0.62, b=0.22, a=0.8)
TEXT_COLOR = ColorRGBA(r=0.9, g=0.9, b=0.9, a=1.0)
CONTACT_COLOR = ColorRGBA(r=0.86, g=0.05, b=0.07, a=1.0)
NORMAL_COLOR = ColorRGBA(r=0.10, g=0.55, b=0.95, a=1.0)
CONTACT_DIAMETER_M = 0.006
NORMAL_LENGTH_M = 0.03
TEXT_HEIGHT_M = 0.02
TEXT_ABOVE_M = 0.12  # the palm
_HAND_ALPHA, _WAY_ALPHA = 0.9, 0.6
_NANOSECONDS = 1_000_000_000


@dataclass(frozen=True, eq=False)
class ShownPart:
    """The part of an answer.

    Attributes
    ----------
    pose : Pose
        In the frame of the grasps.
    uri : str
        Of a mesh file that viewers read; "" where there is none.
    scale : float
        Metres per unit of that file.
    """

    pose: Pose
    uri: str = ""
    scale: float = 1.0


class GraspMarkers:
    """Makes the marker array of a grasp.

    Parameters
    ----------
    hand : HandDescription
    urdf : str
        The hand's URDF text with absolute mesh URIs.
    """

    def __init__(self, hand: HandDescription, urdf: str) -> None:
        self._hand = hand
        self._shapes = _visual_shapes(urdf)

    def array(
        self, grasps: Sequence[Grasp], part: ShownPart | None = None, lifetime_s: float = 0.0
    ) -> MarkerArray:
        """Markers of the first grasp, with the ways to the others; the first one deletes the rest.

        Parameters
        ----------
        grasps : sequence of Grasp
            Messages of one answer, best first.
        part : ShownPart, optional
        lifetime_s : float [s]
            After which viewers take them away; 0: never.
        """
        best = grasps[0]
        markers = [self._part_marker(part)] if part is not None and part.uri else []
        markers += self._hand_markers(best)
        for index, contact in enumerate(best.contacts):
            sphere = Marker(ns="contacts", id=index, type=Marker.SPHERE)
            sphere.pose.position = contact.position
            sphere.scale = Vector3(x=CONTACT_DIAMETER_M, y=CONTACT_DIAMETER_M, z=CONTACT_DIAMETER_M)
            sphere.color = CONTACT_COLOR
            p, n = contact.position, contact.normal_inward
            tail = Point(
                x=p.x - NORMAL_LENGTH_M * n.x,
                y=p.y - NORMAL_LENGTH_M * n.y,
                z=p.z - NORMAL_LENGTH_M * n.z,
            )
            arrow = _arrow("normals_inward", index, tail, p, NORMAL_COLOR)
            markers += [sphere, arrow]
        markers += [
            _arrow(
                "ways" if index else "way",
                index,
                grasp.pre_grasp_palm_pose.pose.position,
                grasp.palm_pose.pose.position,
                quality_color(grasp, _WAY_ALPHA if index else 1.0),
            )
            for index, grasp in enumerate(grasps)
        ]
        markers.append(_text_marker(best))
        whole, part_of_second = divmod(round(lifetime_s * _NANOSECONDS), _NANOSECONDS)
        for marker in markers:
            marker.header = best.palm_pose.header
            marker.lifetime = Duration(sec=whole, nanosec=part_of_second)
        clear = Marker(header=best.palm_pose.header, action=Marker.DELETEALL)
        return MarkerArray(markers=[clear, *markers])

    @staticmethod
    def _part_marker(part: ShownPart) -> Marker:
        return Marker(
            ns="part",
            type=Marker.MESH_RESOURCE,
            pose=part.pose,
            scale=Vector3(x=part.scale, y=part.scale, z=part.scale),
            color=PART_COLOR,
            mesh_resource=part.uri,
        )

    def _hand_markers(self, grasp: Grasp) -> list[Marker]:
        p, q = grasp.palm_pose.pose.position, grasp.palm_pose.pose.orientation
        T_world_palm = from_position_quat_xyzw([p.x, p.y, p.z], [q.x, q.y, q.z, q.w])
        T_world_link = (
            T_world_palm
            @ link_transforms(self._hand, self._hand.joint_count.of_planner(grasp.grasp.position))[
                0
            ]
        )
        color = quality_color(grasp, _HAND_ALPHA)
        markers: list[Marker] = []
        T_of = dict(zip(self._hand.link_names, T_world_link, strict=True))
        T_of |= {f.name: T_of[f.carrier] @ f.T_carrier_frame for f in self._hand.fixed_frames}
        for link, T in T_of.items():
            for shape in self._shapes.get(link, ()):
                [pose] = pose_messages((T @ shape.T_link_shape)[None])
                x, y, z = shape.scale
                markers.append(
                    Marker(
                        ns="hand",
                        id=len(markers),
                        type=shape.kind,
                        pose=pose,
                        scale=Vector3(x=x, y=y, z=z),
                        color=color,
                        mesh_resource=shape.uri,
                    )
                )
        return markers


@dataclass(frozen=True, eq=False)
class _Shape:
    """A visual shape: a mesh by its URI, or a box, cylinder or ellipsoid of edges `scale` [m]."""

    kind: int
    uri: str
    scale: tuple[float, float, float]
    T_link_shape: NDArray[np.float64]


def _arrow(namespace: str, index: int, tail: Point, head: Point, color: ColorRGBA) -> Marker:
    return Marker(
        ns=namespace,
        id=index,
        type=Marker.ARROW,
        points=[tail, head],
        scale=Vector3(x=0.003, y=0.006, z=0.008),  # diameters of shaft and head, its length
        color=color,
    )


def _text_marker(grasp: Grasp) -> Marker:
    """Above the palm, against gravity where the frame's z axis points up."""
    marker = Marker(ns="figures", type=Marker.TEXT_VIEW_FACING, text=quality_text(grasp))
    p = grasp.palm_pose.pose.position
    marker.pose.position = Point(x=p.x, y=p.y, z=p.z + TEXT_ABOVE_M)
    marker.scale.z = TEXT_HEIGHT_M
    marker.color = TEXT_COLOR
    return marker


def _visual_shapes(urdf: str) -> dict[str, tuple[_Shape, ...]]:
    """Meshes, boxes, cylinders and spheres per link."""
    return {
        link.get("name", ""): tuple(
            shape for visual in link.iterfind("visual") if (shape := _shape(visual)) is not None
        )
        for link in ET.fromstring(urdf).iterfind("link")
    }


def _shape(visual: ET.Element) -> _Shape | None:
    origin, geometry = visual.find("origin"), visual.find("geometry")
    given = {} if origin is None else origin.attrib
    xyz, rpy = (np.array(given.get(key, "0 0 0").split(), dtype=float) for key in ("xyz", "rpy"))
    T_link_shape = transform(rotation_from_rpy(rpy), xyz)
    shape = None if geometry is None else next(iter(geometry), None)
    if shape is None:
        return None
    width = 2.0 * float(shape.get("radius", 0))
    kind, scale = {
        "mesh": (Marker.MESH_RESOURCE, shape.get("scale", "1 1 1").split()),
        "box": (Marker.CUBE, shape.get("size", "0 0 0").split()),
        "cylinder": (Marker.CYLINDER, (width, width, shape.get("length", 0))),
        "sphere": (Marker.SPHERE, (width, width, width)),
    }.get(shape.tag, (None, ()))
    if kind is None:
        return None
    x, y, z = np.broadcast_to([float(number) for number in scale], 3).tolist()
    return _Shape(kind, shape.get("filename", ""), (x, y, z), T_link_shape)
