"""A cell in small: node, pose estimator and controller as three processes (``make demo``).

Starts the node as a plain process and a second process that publishes where the mug lies, asks
for grasps, shows answer and messages, draws the best grasp, and ends by itself.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.table import Table

if TYPE_CHECKING:
    from collections.abc import Iterator

# Set before rclpy is imported: the demo shall neither hear nor disturb what else runs here.
os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 101))
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")

import numpy as np
import rclpy
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion
from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

from gpis_grasp_msgs.msg import Grasp, GraspVerification
from gpis_grasp_msgs.srv import PlanGrasp

MESH_ID = "mug"
FRAME = "robot_base"
# The mug stands on a table in front of the robot, turned by 30 degrees.
POSITION = (0.6, 0.1, 0.8)
QUAT_XYZW = (0.0, 0.0, 0.258819, 0.965926)
TABLE_HEIGHT_M = POSITION[2] - 0.0475  # the mug's frame is in its middle
# Half of it for the search, half for the trials in physics.
TIME_BUDGET_S = 15.0
READY_S = 60.0
ESTIMATE_S = 60.0
# A service call over DDS can get lost while the two sides discover each other: ask again.
ANSWER_S, ATTEMPTS = 60.0, 3
PICTURE = Path("out/demo_mug.png")
LATCHED = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)


def publish_pose() -> None:
    """Be the pose estimator: publish the mug's pose five times a second until told to stop."""
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = Node("pose_estimator")
    publisher = node.create_publisher(PoseStamped, "object_pose", 1)
    message = PoseStamped(pose=object_pose())
    message.header.frame_id = FRAME

    def tick() -> None:
        message.header.stamp = node.get_clock().now().to_msg()
        publisher.publish(message)

    node.create_timer(0.2, tick)
    with suppress(KeyboardInterrupt):
        rclpy.spin(node)
    rclpy.shutdown()


def object_pose() -> Pose:
    """Where the mug stands, in the robot's base frame."""
    x, y, z = POSITION
    qx, qy, qz, qw = QUAT_XYZW
    return Pose(position=Point(x=x, y=y, z=z), orientation=Quaternion(x=qx, y=qy, z=qz, w=qw))


@contextmanager
def process(name: str, command: list[str], folder: Path) -> Iterator[tuple[Any, Path]]:
    """Run a process with its output in a file, and end it with SIGTERM."""
    log = folder / f"{name}.log"
    with log.open("wb") as output:
        child = subprocess.Popen(command, stdout=output, stderr=subprocess.STDOUT)
    try:
        yield child, log
    finally:
        child.send_signal(signal.SIGTERM)
        try:
            child.wait(timeout=15.0)
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()


def wait_ready(child: Any, log: Path) -> float:
    """Wait for the node's ready line; return how long it took [s]."""
    start = time.monotonic()
    while "Ready: service" not in log.read_text(errors="replace"):
        if child.poll() is not None or time.monotonic() - start > READY_S:
            raise RuntimeError(f"The node did not become ready:\n{log.read_text(errors='replace')}")
        time.sleep(0.02)
    return time.monotonic() - start


class Controller(Node):
    """Asks for a grasp and listens to what the planner publishes."""

    TOPICS = (
        ("palm_pose", PoseStamped),
        ("grasp_joint_states", JointState),
        ("grasp", Grasp),
        ("grasp_markers", MarkerArray),
        ("robot_description", String),
    )

    def __init__(self) -> None:
        super().__init__("controller")
        self.received: dict[str, Any] = {}
        self._service = self.create_client(PlanGrasp, "plan_grasp")
        for topic, kind in self.TOPICS:
            self.create_subscription(
                kind, topic, lambda message, t=topic: self.received.__setitem__(t, message), LATCHED
            )

    def ask(self) -> tuple[PlanGrasp.Response, float]:
        """Call the service; return the answer and its time [s]."""
        deadline = time.monotonic() + ESTIMATE_S
        while True:
            answer, seconds = self._call()
            # The estimator was started a moment ago, and the two have to find each other.
            if answer.code != PlanGrasp.Response.NO_POSE_ESTIMATE or time.monotonic() > deadline:
                return answer, seconds
            time.sleep(0.2)

    def _call(self) -> tuple[PlanGrasp.Response, float]:
        request = PlanGrasp.Request(mesh_id=MESH_ID, time_budget=TIME_BUDGET_S)
        request.support_plane.header.frame_id = FRAME
        request.support_plane.pose.position.z = TABLE_HEIGHT_M
        for _ in range(ATTEMPTS):
            if not self._service.wait_for_service(timeout_sec=READY_S):
                continue
            start = time.monotonic()
            future = self._service.call_async(request)
            rclpy.spin_until_future_complete(self, future, timeout_sec=ANSWER_S)
            if future.done():
                return future.result(), time.monotonic() - start
        raise RuntimeError("The service plan_grasp gave no answer.")

    def listen(self) -> None:
        """Wait until every topic has brought something."""
        deadline = time.monotonic() + 10.0
        while len(self.received) < len(self.TOPICS) and time.monotonic() < deadline:
            rclpy.spin_once(self, timeout_sec=0.1)


def trials_text(verification: GraspVerification) -> str:
    """Tell in a word what physics said."""
    if not verification.attempted:
        return "not tried"
    passed, run = len(verification.tests_passed), len(verification.tests_run)
    return f"{passed} of {run} passed" if verification.held else "does not hold"


def show_answer(console: Console, answer: PlanGrasp.Response, seconds: float) -> None:
    """Print the grasps as a table."""
    table = Table(title=f"{answer.message} ({answer.evaluations} tried, {seconds:.1f} s)")
    headings = ("#", "epsilon", "volume", "trials", "palm x y z (m)", "orientation x y z w")
    for heading in headings:
        table.add_column(heading, justify="right", no_wrap=True)
    for rank, grasp in enumerate(answer.grasps, start=1):
        p, q = grasp.palm_pose.pose.position, grasp.palm_pose.pose.orientation
        table.add_row(
            str(rank),
            f"{grasp.epsilon:.4f}",
            f"{grasp.volume:.4f}",
            trials_text(grasp.verification),
            f"{p.x:.3f} {p.y:.3f} {p.z:.3f}",
            f"{q.x:.3f} {q.y:.3f} {q.z:.3f} {q.w:.3f}",
        )
    console.print(table)
    best = answer.grasps[0]
    joints = Table(title="Finger joints of the best grasp (rad)")
    for heading in ("joint", "pre-grasp", "grasp"):
        joints.add_column(heading, justify="right")
    for name, before, closed in zip(
        best.grasp.name, best.pre_grasp.position, best.grasp.position, strict=True
    ):
        joints.add_row(name, f"{before:.4f}", f"{closed:.4f}")
    console.print(joints)
    d = best.approach_direction.vector
    console.print(
        f"approach: {best.approach_distance:.3f} m along ({d.x:.3f}, {d.y:.3f}, {d.z:.3f}); "
        f"mesh hash {best.mesh_hash[:12]}..."
    )
    for test in best.verification.tests_run:
        verdict = "passed" if test in best.verification.tests_passed else "failed"
        console.print(f"trial in physics: {test}: {verdict}")
    for note in answer.notes:
        console.print(f"note: {note}")


def show_messages(console: Console, controller: Controller) -> None:
    """Print what a subscriber received."""
    table = Table(title="Messages a subscriber received")
    for heading in ("topic", "type", "stamp", "content"):
        table.add_column(heading)
    for topic, kind in controller.TOPICS:
        message = controller.received.get(topic)
        header = getattr(message, "header", None)
        stamp = f"{header.stamp.sec}.{header.stamp.nanosec:09d}" if header else "-"
        match message:
            case None:
                content = "nothing"
            case PoseStamped():
                p = message.pose.position
                content = f"{p.x:.3f} {p.y:.3f} {p.z:.3f} in {message.header.frame_id}"
            case JointState():
                content = " ".join(f"{q:.2f}" for q in message.position)
            case Grasp():
                content = f"epsilon {message.epsilon:.4f}, {len(message.contacts)} contacts"
            case MarkerArray():
                content = f"{len(message.markers)} markers"
            case _:
                content = f"URDF, {len(message.data)} characters"
        table.add_row(f"/{topic}", kind.__name__, stamp, content)
    console.print(table)


def draw(grasp: Grasp, path: Path) -> None:
    """Draw the hand on the mug on the table, from the message alone and the mesh."""
    from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
    from gpis_grasp_planner.geometry.transforms import apply, from_position_quat_xyzw, inverse
    from gpis_grasp_planner.hand.description import load_hand
    from gpis_grasp_planner.quality.contacts import Contacts
    from gpis_grasp_planner.surroundings.obstacles import SupportPlane, Surroundings
    from gpis_grasp_planner.view.grasp_scene import surrounding_meshes
    from gpis_grasp_planner.view.picture import render_grasp

    hand = load_hand()
    part = MeshCatalogue([default_catalogue_directory()]).load(MESH_ID)
    p, q = grasp.palm_pose.pose.position, grasp.palm_pose.pose.orientation
    T_object_base = inverse(from_position_quat_xyzw(POSITION, QUAT_XYZW))
    T_base_palm = from_position_quat_xyzw([p.x, p.y, p.z], [q.x, q.y, q.z, q.w])
    positions = np.array([[c.position.x, c.position.y, c.position.z] for c in grasp.contacts])
    normals = np.array(
        [[c.normal_inward.x, c.normal_inward.y, c.normal_inward.z] for c in grasp.contacts]
    )
    contacts = Contacts(
        apply(T_object_base, positions),
        normals @ T_object_base[:3, :3].T,
        np.array([c.friction for c in grasp.contacts]),
        np.array([hand.link_names.index(c.link) for c in grasp.contacts]),
    )
    table = Surroundings(
        support=SupportPlane(np.array([*POSITION[:2], TABLE_HEIGHT_M]), np.array([0.0, 0.0, 1.0]))
    ).moved(T_object_base)
    d = grasp.approach_direction.vector
    path.parent.mkdir(parents=True, exist_ok=True)
    render_grasp(
        part.mesh,
        hand,
        T_object_base @ T_base_palm,
        np.array(grasp.grasp.position),
        contacts,
        path=path,
        caption=f"{MESH_ID}: epsilon {grasp.epsilon:.3f}, volume {grasp.volume:.4f}",
        around=list(surrounding_meshes(table, part.mesh.vertices).values()),
        approach=grasp.approach_distance * T_object_base[:3, :3] @ np.array([d.x, d.y, d.z]),
    )


def run(console: Console, picture: Path) -> int:
    """Play the demo; 0 if the planner answered with grasps."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="gpis_demo_")))
        console.rule("1. The node")
        command = [sys.executable, "-m", "gpis_grasp_planner.ros.node"]
        node, log = stack.enter_context(process("node", command, folder))
        console.print(f"started as process {node.pid}, ready after {wait_ready(node, log):.1f} s")
        console.rule("2. The pose estimate, from a process of its own")
        publisher = [sys.executable, str(Path(__file__).resolve()), "--publish-pose"]
        estimator, _ = stack.enter_context(process("estimator", publisher, folder))
        console.print(f"process {estimator.pid} publishes /object_pose at 5 Hz")
        rclpy.init()
        stack.callback(rclpy.try_shutdown)
        controller = Controller()
        stack.callback(controller.destroy_node)
        console.rule(f"3. plan_grasp '{MESH_ID}'")
        answer, seconds = controller.ask()
        if answer.code == PlanGrasp.Response.NO_GRASP_HOLDS:  # on a machine with other work
            console.print(f"Code {answer.code}: {answer.message} Asked again.")
            answer, seconds = controller.ask()
        if not answer.success:
            console.print(f"No grasp, code {answer.code}: {answer.message}")
            return 1
        show_answer(console, answer, seconds)
        again, seconds = controller.ask()
        source = "from memory" if again.from_cache else "planned anew"
        console.print(f"the second call: {1e3 * seconds:.0f} ms, {source}")
        console.rule("4. What the node publishes")
        controller.listen()
        show_messages(console, controller)
        console.rule("5. A picture")
        draw(controller.received["grasp"], picture)
        console.print(f"{picture}")
    console.print(f"node ended with exit code {node.returncode}")
    return 0 if node.returncode == 0 else 1


def main() -> int:
    """Parse the options and play."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--picture", type=Path, default=PICTURE, help="PNG to write")
    parser.add_argument("--publish-pose", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.publish_pose:
        publish_pose()
        return 0
    console = Console(width=None if sys.stdout.isatty() else 120, highlight=False)
    return run(console, options.picture)


if __name__ == "__main__":
    sys.exit(main())
