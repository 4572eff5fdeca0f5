"""A page in the browser that shows a :class:`~gpis_grasp_planner.view.grasp_scene.GraspScene`.

Only this module speaks viser. The part, the hand and what belongs to a grasp lie under the node
``/object``, which has the part's pose; the surroundings and the arm are in the world's frame.
"""

from __future__ import annotations

import io
import threading
import time
from collections.abc import Sequence
from contextlib import redirect_stdout
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.extras import how_to_install
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.transforms import to_position_quat_xyzw
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.view.grasp_motion import MotionFrame
from gpis_grasp_planner.view.grasp_scene import (
    ORDERS,
    GraspScene,
    arm_shape,
    friction_cones,
    sorted_indices,
    trials_text,
)

Array = NDArray[np.float64]
Color = tuple[int, int, int]

_PART, _PALM, _FINGER, _ARM = (237, 158, 56), (58, 61, 66), (120, 130, 145), (200, 120, 60)
_CONTACT, _NORMAL, _AROUND = (219, 13, 18), (25, 140, 242), (150, 158, 150)
_FORCE, _TORQUE, _MODEL = (190, 30, 190), (120, 90, 220), (40, 160, 90)
_FRAME_S = 0.05
_ARROW_M = 0.05
_WRENCH_M = 0.15  # of a wrench of length 1
_LAYERS = ("part", "hand", "contacts", "weakest direction", "surroundings", "arm", "model")


class GraspPage:
    """Serves one scene until :meth:`close`.

    Parameters
    ----------
    scene : GraspScene
    host, port : str, int
        Where to listen; the next free port where this one is taken.

    Raises
    ------
    RequestError
        Where viser is not installed.
    """

    def __init__(self, scene: GraspScene, host: str = "127.0.0.1", port: int = 8080):
        try:
            import viser
        except ImportError:
            raise RequestError(how_to_install("The viewer", "viser", "view")) from None
        self._lock = threading.RLock()
        self._playing = threading.Lock()
        self._scene = scene
        with redirect_stdout(io.StringIO()):  # it would print a box of its own
            self._server = viser.ViserServer(host, port, label="gpis-grasp view", verbose=False)
        self._nodes: dict[str, list[Any]] = {layer: [] for layer in _LAYERS}
        self._rows: list[int] = []
        self._frames: Sequence[MotionFrame] = ()
        self._add_still()
        self._add_controls()
        self.show_grasps(scene)

    @property
    def address(self) -> str:
        """What to open in the browser."""
        return f"http://{self._server.get_host()}:{self._server.get_port()}"

    def close(self) -> None:
        """Stop serving."""
        self._server.stop()

    def show_grasps(self, scene: GraspScene) -> None:
        """List the grasps of a scene of the same part and hand, and show the first."""
        with self._lock:
            self._scene = scene
            if scene.arm is not None and not self._arm_links:
                self._add_arm()
            self._sort()

    def say(self, text: str) -> None:
        """Put a line of news above the list."""
        self._news.content = text

    def add_model(self, meshes: Sequence[TriangleMesh], charts: Sequence[Array]) -> None:
        """Show ellipsoids, and charts as closed lines (n, 3) [m], all in the object's frame."""
        for number, mesh in enumerate(meshes):
            self._mesh("model", f"/object/model/{number}", mesh, _MODEL, wireframe=True)
        for number, ring in enumerate(charts):
            lines = np.stack([ring, np.roll(ring, -1, axis=0)], axis=1)
            node = self._server.scene.add_line_segments(
                f"/object/model/chart{number}", lines, _MODEL, thickness=0.0008
            )
            self._nodes["model"].append(node)

    def _add_still(self) -> None:
        scene, server = self._scene, self._server.scene
        server.set_up_direction("+z")
        self._object = server.add_frame("/object", show_axes=False)
        _place(self._object, scene.place.T_world_object)
        self._part = server.add_frame("/object/part", show_axes=False)
        # contacts' cones and the weakest direction begin inside of it
        self._mesh("part", "/object/part/mesh", scene.part.mesh, _PART, opacity=0.75)
        for name, mesh in scene.surroundings().items():
            self._mesh("surroundings", f"/around/{name}", mesh, _AROUND)
        self._links = []
        for link, name in enumerate(scene.hand.link_names):
            self._links.append(server.add_frame(f"/object/hand/{name}", show_axes=False))
            palm = scene.hand.link_friction_group[link] == "palm"
            for number, mesh in enumerate(scene.link_shapes[link]):
                path = f"/object/hand/{name}/{number}"
                self._mesh("hand", path, mesh, _PALM if palm else _FINGER)
        self._arm_links: list[Any] = []
        points = scene.part.mesh.bounds
        middle = scene.place.T_world_object @ np.append(points.mean(axis=0), 1.0)
        distance = scene.part.mesh.diagonal + 0.25
        self._server.initial_camera.look_at = middle[:3]
        self._server.initial_camera.position = middle[:3] + distance * np.array([0.7, -0.7, 0.45])

    def _add_arm(self) -> None:
        arm = self._scene.arm
        assert arm is not None
        for link in range(arm.n_joints + 1):
            self._arm_links.append(self._server.scene.add_frame(f"/arm/{link}", show_axes=False))
        for number, body in enumerate(arm.chain.bodies):
            path = f"/arm/{body.link}/{number}"
            self._mesh("arm", path, arm_shape(body), _ARM, opacity=0.8)

    def _mesh(
        self,
        layer: str,
        path: str,
        mesh: TriangleMesh,
        color: Color,
        opacity: float | None = None,
        wireframe: bool = False,
    ) -> None:
        node = self._server.scene.add_mesh_simple(
            path,
            mesh.vertices.astype(np.float32),
            mesh.faces.astype(np.uint32),
            color=color,
            opacity=opacity,
            wireframe=wireframe,
            flat_shading=not wireframe,
            side="double",
        )
        self._nodes[layer].append(node)

    def _add_controls(self) -> None:
        gui = self._server.gui
        self._news = gui.add_markdown(f"**{self._scene.part.mesh_id}**, {self._scene.hand.name}")
        self._order: Any = gui.add_dropdown("sort by", ORDERS)
        self._choice: Any = gui.add_dropdown("grasp", ("none",))
        self._figures = gui.add_markdown("")
        self._moment: Any = gui.add_slider("moment", 0, 1, 1, 1)
        self._phase = gui.add_markdown("")
        play = gui.add_button("play")
        self._layers = {}
        with gui.add_folder("show"):
            for layer in _LAYERS:
                box = gui.add_checkbox(layer, True)
                box.on_update(lambda _: self._show_layers())
                self._layers[layer] = box
        self._list = gui.add_markdown("")
        self._order.on_update(lambda _: self._sort())
        self._choice.on_update(lambda _: self._choose())
        self._moment.on_update(lambda _: self._move())
        play.on_click(lambda _: self._play())

    def _show_layers(self) -> None:
        for layer, nodes in self._nodes.items():
            for node in nodes:
                # without a grasp the hand has no place
                there = layer != "hand" or bool(self._frames)
                node.visible = self._layers[layer].value and there

    def _sort(self) -> None:
        with self._lock:
            grasps = self._scene.grasps
            rows = sorted_indices(grasps, self._order.value)
            labels = [f"{i}: epsilon {grasps[i].epsilon:.4f}" for i in rows]
            lines = [
                f"| {i} | {grasps[i].epsilon:.4f} | {grasps[i].volume:.4f} | "
                f"{trials_text(grasps[i])} |"
                for i in rows
            ]
            head = "| # | epsilon | volume | trials passed |\n|---|---|---|---|\n"
            self._list.content = head + "\n".join(lines) if rows else "No grasps."
            self._rows = rows
            self._choice.options = tuple(labels) or ("none",)
            self._choice.value = self._choice.options[0]
            self._choose()

    def _choose(self) -> None:
        with self._lock:
            for layer in ("contacts", "weakest direction"):
                for node in self._nodes[layer]:
                    node.remove()
                self._nodes[layer] = []
            if not self._rows or self._choice.value not in self._choice.options:
                self._frames = ()
                self._show_layers()
                return
            grasp = self._scene.grasps[self._rows[self._choice.options.index(self._choice.value)]]
            self._figures.content = (
                f"epsilon **{grasp.epsilon:.4f}**, volume **{grasp.volume:.4f}**, "
                f"trials {trials_text(grasp)}, {len(grasp.contacts)} contacts"
                if grasp.feasible
                else f"**no force closure**, {len(grasp.contacts)} contacts"
            )
            self._add_contacts(grasp)
            self._frames = self._scene.motion(grasp)
            closed = max(i for i, f in enumerate(self._frames) if f.phase == "closing")
            self._moment.max = len(self._frames) - 1
            self._moment.value = closed
            self._show_layers()
            self._move()

    def _add_contacts(self, grasp: Grasp) -> None:
        contacts = grasp.contacts
        for number, mesh in enumerate(friction_cones(grasp)):
            self._mesh("contacts", f"/object/part/cone{number}", mesh, _CONTACT)
        normals = np.stack(
            [contacts.positions - _ARROW_M * contacts.normals_inward, contacts.positions], axis=1
        )
        if len(normals):
            self._arrows("contacts", "normals", normals, _NORMAL)
        weakest = self._scene.weakest(grasp)
        if weakest is None:
            return
        for name, vector, color in (
            ("force", weakest.force, _FORCE),
            ("torque", weakest.torque, _TORQUE),
        ):
            ends = np.stack([weakest.point, weakest.point + _WRENCH_M * vector])
            self._arrows("weakest direction", name, ends[None], color)

    def _arrows(self, layer: str, name: str, ends: Array, color: Color) -> None:
        node = self._server.scene.add_arrows(
            f"/object/part/{name}",
            ends.astype(np.float32),
            color,
            shaft_radius=0.002,
            head_radius=0.005,
            head_length=0.012,
        )
        self._nodes[layer].append(node)

    def _move(self) -> None:
        with self._lock:
            if not self._frames:
                return
            frame = self._frames[min(int(self._moment.value), len(self._frames) - 1)]
            self._phase.content = f"phase: **{frame.phase}**"
            with self._server.atomic():
                for node, T in zip(self._links, self._scene.link_poses(frame), strict=True):
                    _place(node, T)
                _place(self._part, frame.T_object_part)
                for node, T in zip(self._arm_links, self._scene.arm_poses(frame), strict=False):
                    _place(node, T)

    def _play(self) -> None:
        if not self._playing.acquire(blocking=False):
            return
        try:
            self._run_through()
        finally:
            self._playing.release()

    def _run_through(self) -> None:
        for number in range(len(self._frames)):
            self._moment.value = number
            self._move()
            time.sleep(_FRAME_S)


def _place(node: Any, T: Array) -> None:
    position, quat_xyzw = to_position_quat_xyzw(T)
    node.position = position
    node.wxyz = quat_xyzw[[3, 0, 1, 2]]
