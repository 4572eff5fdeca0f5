"""The part of 'view' that shows what a node publishes."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from gpis_grasp_planner.cli import options
from gpis_grasp_planner.cli.exit_codes import SUCCESS
from gpis_grasp_planner.cli.interrupt import raise_on_signals
from gpis_grasp_planner.cli.output import note

if TYPE_CHECKING:
    from collections.abc import Callable

    from gpis_grasp_planner.geometry.catalogue import MeshCatalogue
    from gpis_grasp_planner.geometry.part import Part
    from gpis_grasp_planner.hand.description import HandDescription
    from gpis_grasp_planner.ros.grasp_watch import SeenGrasp
    from gpis_grasp_planner.view.page import GraspPage


def serve(arguments: argparse.Namespace) -> int:
    """Serve until Ctrl-C; the page opens with the first grasp, whose part it shows."""
    from gpis_grasp_planner.errors import RequestError
    from gpis_grasp_planner.hand.description import load_hand

    try:
        from gpis_grasp_planner.ros.grasp_watch import GraspWatch
    except ModuleNotFoundError as error:
        raise RequestError(
            f"--ros needs ROS 2, and {error.name} is not there. Source scripts/env.sh, or the "
            "setup file of a ROS 2 Jazzy and of the workspace."
        ) from None
    assignments = options.with_hand(arguments.assignments, arguments.hand)
    settings, catalogue_settings = options.read_settings(arguments.settings, assignments)
    hand = load_hand(settings.hand.model)
    catalogue = options.catalogue_of(arguments.meshes, catalogue_settings)
    from gpis_grasp_planner.cli.view import say_address

    def tell_address(address: str) -> None:
        say_address(arguments, address, "what the node publishes")

    shown = _Shown(hand, catalogue, arguments.host, arguments.port, tell_address)
    raise_on_signals()
    try:
        with GraspWatch(hand, shown.show, shown.tell, arguments.namespace) as watch:
            note(f"gpis-grasp: waits for a grasp on {watch.topic}; Ctrl-C ends.")
            while True:
                watch.spin()
    except KeyboardInterrupt:
        return SUCCESS
    finally:
        shown.close()


class _Shown:
    """Brings what is seen onto a page; the part is read once as long as it is the same."""

    def __init__(
        self,
        hand: HandDescription,
        catalogue: MeshCatalogue,
        host: str,
        port: int,
        tell_address: Callable[[str], None],
    ) -> None:
        self._hand, self._catalogue = hand, catalogue
        self._host, self._port, self._tell_address = host, port, tell_address
        self._part: Part | None = None
        self._page: GraspPage | None = None

    def show(self, seen: SeenGrasp) -> None:
        """Show a grasp where its part is known here.

        Raises
        ------
        GraspPlannerError
            Where it is not, or is another version of it.
        """
        from gpis_grasp_planner.surroundings.place import Place
        from gpis_grasp_planner.view.grasp_scene import GraspScene
        from gpis_grasp_planner.view.page import GraspPage

        place = Place(T_world_object=seen.T_world_object)
        scene = GraspScene(self._part_of(seen), self._hand, place, (seen.grasp,))
        if self._page is None:
            self._page = GraspPage(scene, self._host, self._port)
            self._tell_address(self._page.address)
        else:
            self._page.show_grasps(scene)
        self._page.say(f"**{seen.mesh_id}** in the frame **{seen.frame_id}**")

    def tell(self, trouble: str) -> None:
        """Say what cannot be shown, on stderr and on the page where there is one."""
        note(f"gpis-grasp: not shown: {trouble}")
        if self._page is not None:
            self._page.say(f"**Not shown:** {trouble} Below is the grasp before.")

    def close(self) -> None:
        """Stop serving."""
        if self._page is not None:
            self._page.close()

    def _part_of(self, seen: SeenGrasp) -> Part:
        from gpis_grasp_planner.errors import RequestError

        part = self._part
        if part is None or (part.mesh_id, part.mesh.content_hash) != (seen.mesh_id, seen.mesh_hash):
            part = self._catalogue.load(seen.mesh_id)
        if part.mesh.content_hash != seen.mesh_hash:
            raise RequestError(
                f"The mesh '{seen.mesh_id}' here is not the one that the node planned for. Name "
                "the node's catalogue with --meshes."
            )
        self._part = part
        return part
