"""A grasp for RViz: the hand's meshes, the contacts and their normals."""

from __future__ import annotations

from dataclasses import dataclass
from xml.etree import ElementTree as ET

import numpy as np
from geometry_msgs.msg import Point, Vector3
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

HAND_COLOR = ColorRGBA(r=0.45, g=0.47, b=0.50, a=0.9)
CONTACT_COLOR = ColorRGBA(r=0.86, g=0.05, b=0.07, a=1.0)
NORMAL_COLOR = ColorRGBA(r=0.10, g=0.55, b=0.95, a=1.0)
CONTACT_DIAMETER_M = 0.006
NORMAL_LENGTH_M = 0.03


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

    def array(self, grasp: Grasp) -> MarkerArray:
        """Markers of the closed hand, contacts (spheres) and inward normals (arrows).

        The first marker deletes those of the grasp shown before.
        """
        markers = [Marker(header=grasp.palm_pose.header, action=Marker.DELETEALL)]
        markers += self._hand_markers(grasp)
        header = grasp.palm_pose.header
        for index, contact in enumerate(grasp.contacts):
            sphere = Marker(header=header, ns="contacts", id=index, type=Marker.SPHERE)
            sphere.pose.position = contact.position
            sphere.scale = Vector3(x=CONTACT_DIAMETER_M, y=CONTACT_DIAMETER_M, z=CONTACT_DIAMETER_M)
            sphere.color = CONTACT_COLOR
            arrow = Marker(header=header, ns="normals_inward", id=index, type=Marker.ARROW)
            p, n = contact.position, contact.normal_inward
            tail = Point(
                x=p.x - NORMAL_LENGTH_M * n.x,
                y=p.y - NORMAL_LENGTH_M * n.y,
                z=p.z - NORMAL_LENGTH_M * n.z,
            )
            arrow.points = [tail, p]
            arrow.scale = Vector3(x=0.003, y=0.006, z=0.008)
            arrow.color = NORMAL_COLOR
            markers += [sphere, arrow]
        return MarkerArray(markers=markers)

    def _hand_markers(self, grasp: Grasp) -> list[Marker]:
        p, q = grasp.palm_pose.pose.position, grasp.palm_pose.pose.orientation
        T_world_palm = from_position_quat_xyzw([p.x, p.y, p.z], [q.x, q.y, q.z, q.w])
        T_world_link = T_world_palm @ link_transforms(self._hand, list(grasp.grasp.position))[0]
        markers: list[Marker] = []
        for link, T in zip(self._hand.link_names, T_world_link, strict=True):
            for shape in self._shapes.get(link, ()):
                [pose] = pose_messages((T @ shape.T_link_shape)[None])
                x, y, z = shape.scale
                markers.append(
                    Marker(
                        header=grasp.palm_pose.header,
                        ns="hand",
                        id=len(markers),
                        type=Marker.MESH_RESOURCE if shape.uri else Marker.CUBE,
                        pose=pose,
                        scale=Vector3(x=x, y=y, z=z),
                        color=HAND_COLOR,
                        mesh_resource=shape.uri,
                    )
                )
        return markers


@dataclass(frozen=True, eq=False)
class _Shape:
    """A visual shape: a mesh by its URI, or without one a box of edges `scale` [m]."""

    uri: str
    scale: tuple[float, float, float]
    T_link_shape: NDArray[np.float64]


def _visual_shapes(urdf: str) -> dict[str, tuple[_Shape, ...]]:
    """Meshes and boxes per link."""
    return {
        link.get("name", ""): tuple(
            _shape(visual)
            for visual in link.iterfind("visual")
            if visual.find("geometry/mesh") is not None or visual.find("geometry/box") is not None
        )
        for link in ET.fromstring(urdf).iterfind("link")
    }


def _shape(visual: ET.Element) -> _Shape:
    origin, mesh = visual.find("origin"), visual.find("geometry/mesh")
    given = {} if origin is None else origin.attrib
    xyz, rpy = (np.array(given.get(key, "0 0 0").split(), dtype=float) for key in ("xyz", "rpy"))
    T_link_shape = transform(rotation_from_rpy(rpy), xyz)
    if mesh is not None:
        x, y, z = (float(number) for number in mesh.get("scale", "1 1 1").split())
        return _Shape(mesh.get("filename", ""), (x, y, z), T_link_shape)
    box = visual.find("geometry/box")
    assert box is not None
    x, y, z = (float(number) for number in box.get("size", "").split())
    return _Shape("", (x, y, z), T_link_shape)
