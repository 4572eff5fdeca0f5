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
from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.extras import how_to_install
from gpis_grasp_planner.geometry.mesh import TriangleMesh
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
from gpis_grasp_planner.view.lost_palm_colors import PaintedPalms, painted_palms
from gpis_grasp_planner.view.page_nodes import PageNodes, place

Array = NDArray[np.float64]

_PART, _PALM, _FINGER, _ARM = (237, 158, 56), (58, 61, 66), (120, 130, 145), (200, 120, 60)
_CONTACT, _NORMAL, _AROUND = (219, 13, 18), (25, 140, 242), (150, 158, 150)
_FORCE, _TORQUE, _MODEL = (190, 30, 190), (120, 90, 220), (40, 160, 90)
_FRAME_S = 0.05
_ARROW_M = 0.05
_WRENCH_M = 0.15  # of a wrench of length 1
_LAYERS = (
    "part", "hand", "contacts", "weakest direction", "surroundings", "arm", "model", "lost palms",
)  # fmt: skip


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
        self._nodes = PageNodes(self._server.scene, _LAYERS)
        self._rows: list[int] = []
        self._frames: Sequence[MotionFrame] = ()
        self._server.scene.set_up_direction("+z")
        self._add_hand()
        self._add_part()
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
        """List the grasps of a scene of the same hand, and show the first.

        Where the scene has another part, or it lies elsewhere, part and surroundings are new.
        """
        with self._lock:
            before, self._scene = self._scene, scene
            if scene.part is not before.part or scene.place is not before.place:
                self._add_part()
            if scene.arm is not None and not self._arm_links:
                self._add_arm()
            self._add_lost(painted_palms(scene.lost_palms, scene.funnel))
            self._sort()

    def say(self, text: str) -> None:
        """Put a line of news above the list."""
        self._news.content = text

    def add_model(self, meshes: Sequence[TriangleMesh], charts: Sequence[Array]) -> None:
        """Show ellipsoids, and charts as closed lines (n, 3) [m], all in the object's frame."""
        for number, mesh in enumerate(meshes):
            self._nodes.mesh("model", f"/object/model/{number}", mesh, _MODEL, wireframe=True)
        for number, ring in enumerate(charts):
            self._nodes.ring("model", f"/object/model/chart{number}", ring, _MODEL)

    def _add_hand(self) -> None:
        scene = self._scene
        self._object = self._nodes.frame("/object")
        # contacts' cones and the weakest direction begin inside of the part
        self._part = self._nodes.frame("/object/part")
        self._links = []
        for link, name in enumerate(scene.hand.link_names):
            self._links.append(self._nodes.frame(f"/object/hand/{name}"))
            palm = scene.hand.link_friction_group[link] == "palm"
            for number, mesh in enumerate(scene.link_shapes[link]):
                path = f"/object/hand/{name}/{number}"
                self._nodes.mesh("hand", path, mesh, _PALM if palm else _FINGER)
        self._arm_links: list[Any] = []

    def _add_part(self) -> None:
        scene = self._scene
        T_world_object = scene.place.T_world_object
        place(self._object, T_world_object)
        for layer in ("part", "surroundings"):
            self._nodes.clear(layer)
        self._nodes.mesh("part", "/object/part/mesh", scene.part.mesh, _PART, opacity=0.75)
        for name, mesh in scene.surroundings().items():
            self._nodes.mesh("surroundings", f"/around/{name}", mesh, _AROUND)
        middle = T_world_object @ np.append(scene.part.mesh.bounds.mean(axis=0), 1.0)
        distance = scene.part.mesh.diagonal + 0.25
        look_at, position = middle[:3], middle[:3] + distance * np.array([0.7, -0.7, 0.45])
        self._server.initial_camera.look_at = look_at
        self._server.initial_camera.position = position
        for client in self._server.get_clients().values():
            client.camera.look_at, client.camera.position = look_at, position

    def _add_arm(self) -> None:
        arm = self._scene.arm
        assert arm is not None
        for link in range(arm.n_joints + 1):
            self._arm_links.append(self._nodes.frame(f"/arm/{link}"))
        for number, body in enumerate(arm.chain.bodies):
            path = f"/arm/{body.link}/{number}"
            self._nodes.mesh("arm", path, arm_shape(body), _ARM, opacity=0.8)

    def _add_lost(self, painted: Sequence[PaintedPalms]) -> None:
        self._nodes.clear("lost palms")
        for number, palms in enumerate(painted):
            path = f"/object/lost/{number}"
            self._nodes.points("lost palms", path, palms.positions, palms.color)
        self._legend.visible = bool(painted)
        self._legend.content = _legend(painted)

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
                # one looks at a grasp first, and at what was lost where one asks for it
                box = gui.add_checkbox(layer, layer != "lost palms" or not self._scene.grasps)
                box.on_update(lambda _: self._show_layers())
                self._layers[layer] = box
        self._legend = gui.add_html("", visible=False)
        self._list = gui.add_markdown("")
        self._order.on_update(lambda _: self._sort())
        self._choice.on_update(lambda _: self._choose())
        self._moment.on_update(lambda _: self._move())
        play.on_click(lambda _: self._play())

    def _show_layers(self) -> None:
        visible = {layer: bool(box.value) for layer, box in self._layers.items()}
        visible["hand"] &= bool(self._frames)  # without a grasp it has no place
        self._nodes.show(visible)

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
                self._nodes.clear(layer)
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
            self._nodes.mesh("contacts", f"/object/part/cone{number}", mesh, _CONTACT)
        normals = np.stack(
            [contacts.positions - _ARROW_M * contacts.normals_inward, contacts.positions], axis=1
        )
        if len(normals):
            self._nodes.arrows("contacts", "/object/part/normals", normals, _NORMAL)
        weakest = self._scene.weakest(grasp)
        if weakest is None:
            return
        for name, vector, color in (
            ("force", weakest.force, _FORCE),
            ("torque", weakest.torque, _TORQUE),
        ):
            ends = np.stack([weakest.point, weakest.point + _WRENCH_M * vector])
            path = f"/object/part/{name}"
            self._nodes.arrows("weakest direction", path, ends[None], color)

    def _move(self) -> None:
        with self._lock:
            if not self._frames:
                return
            frame = self._frames[min(int(self._moment.value), len(self._frames) - 1)]
            self._phase.content = f"phase: **{frame.phase}**"
            with self._server.atomic():
                for node, T in zip(self._links, self._scene.link_poses(frame), strict=True):
                    place(node, T)
                place(self._part, frame.T_object_part)
                for node, T in zip(self._arm_links, self._scene.arm_poses(frame), strict=False):
                    place(node, T)

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


def _legend(painted: Sequence[PaintedPalms]) -> str:
    """A line of HTML for each cause."""
    lines = [
        f'<div><span style="color: rgb{palms.color}">&#9679;</span> {escape(palms.label)}</div>'
        for palms in painted
    ]
    style = "font-size: 12px; padding: 0 0.75em"
    return f'<div style="{style}"><b>lost palms</b>, some of each cause{"".join(lines)}</div>'
