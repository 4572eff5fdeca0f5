"""The node: ``ros2 run gpis_grasp_planner grasp_planner_node``, or this module as a script.

:func:`main_lifecycle` (``grasp_planner_lifecycle_node``) is the same as a managed node.

``docs/node.md`` describes topics, services, the action and codes; ``docs/parameters.md`` the
parameters. Everything large is imported inside :func:`main`: a signal that comes during the
imports ends the node as orderly as a later one.
"""

from __future__ import annotations

import gc
import os
import signal
import sys
import tempfile
import threading
import time
from pathlib import Path

EXIT_CONFIGURATION = 2
# After a signal; an orderly end takes less, also where requests in work are answered.
LEAVE_S = 15.0
HELP = """\
usage: {name} [--ros-args [-p NAME:=VALUE] [--params-file FILE.yaml] [-r FROM:=TO] ...]

Plans grasps on the service plan_grasp and the action of that name; ends on Ctrl-C.

  {name} --ros-args -p "mesh_directories:=['/home/me/parts']"
  {name} --ros-args --params-file cell.yaml

Parameters: docs/parameters.md. Topics, service, action, codes: docs/node.md.
"""


def main_lifecycle(args: list[str] | None = None) -> int:
    """Run the lifecycle node as :func:`main` runs the plain one."""
    return main(args, lifecycle=True)


def main(args: list[str] | None = None, *, lifecycle: bool = False) -> int:
    """Run the node until SIGINT or SIGTERM; 0 then, 2 where it cannot start as configured.

    The process is gone `LEAVE_S` after the signal at the latest, whatever it was doing by then.
    """
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    threading.Thread(target=leave_at_last, args=(stop,), daemon=True).start()
    if "--help" in (sys.argv if args is None else args)[1:]:
        name = "grasp_planner_lifecycle_node" if lifecycle else "grasp_planner_node"
        sys.stdout.write(HELP.format(name=name))
        return 0
    insist_on_security()
    args = [*(sys.argv if args is None else args), *without_log_files()]
    import rclpy
    from rclpy._rclpy_pybind11 import RCLError, RCLInvalidROSArgsError, UnknownROSArgsError
    from rclpy.signals import SignalHandlerOptions

    from gpis_grasp_planner.errors import GraspPlannerError
    from gpis_grasp_planner.ros.lifecycle_node import GraspPlannerLifecycleNode
    from gpis_grasp_planner.ros.parameter_sections import passed_over
    from gpis_grasp_planner.ros.planner_node import NODE_NAME, GraspPlannerNode, spin
    from gpis_grasp_planner.ros.text import printable

    if stop.is_set():
        return 0
    node: GraspPlannerNode | GraspPlannerLifecycleNode
    try:
        # rclpy's own handlers would close the context before waiting requests are answered.
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
        node = GraspPlannerLifecycleNode() if lifecycle else GraspPlannerNode()
    except (GraspPlannerError, RCLError, RCLInvalidROSArgsError, UnknownROSArgsError) as error:
        rclpy.logging.get_logger(NODE_NAME).fatal(f"Not started: {printable(error, 1000)}")
        rclpy.try_shutdown()
        return EXIT_CONFIGURATION
    except (OSError, MemoryError, RuntimeError) as error:
        if isinstance(error, RuntimeError) and "thread" not in str(error):
            raise
        rclpy.logging.get_logger(NODE_NAME).fatal(
            f"Not started: the system refuses what the node needs ({printable(repr(error), 400)}). "
            "Look at its limits of memory, threads and open files (ulimit -a)."
        )
        rclpy.try_shutdown()
        return EXIT_CONFIGURATION
    for text in passed_over(args, node.get_fully_qualified_name()):
        node.get_logger().warning(text)
    # A full collection looks at all that was imported, with every thread waiting.
    gc.collect()
    gc.freeze()
    try:
        spin(node, stop)
    finally:
        gc.unfreeze()
        rclpy.try_shutdown()
    return 0


def leave_at_last(stop: threading.Event) -> None:
    """End the process some time after `stop`, whatever keeps it.

    Python waits for each thread of a pool at its end, and a thread that reads the catalogue from a
    disk that does not answer waits for ever.
    """
    stop.wait()
    time.sleep(LEAVE_S)
    try:
        sys.stderr.write("Ended while a request still waited, for a disk most likely.\n")
        sys.stderr.flush()
    finally:  # there may be no stderr
        os._exit(0)


def insist_on_security() -> None:
    """Where security is asked for, let a node that cannot have it fail.

    rcl's default with ``ROS_SECURITY_ENABLE=true`` is permissive: without keys, or with a
    middleware that was built without security, the node would start unsecured and say nothing.
    """
    if os.environ.get("ROS_SECURITY_ENABLE", "").lower() == "true":
        os.environ["ROS_SECURITY_STRATEGY"] = "Enforce"


def without_log_files() -> list[str]:
    """Arguments that switch ROS' log files off where their folder cannot be written.

    rcl does not start at all there: no home, or a read-only container. The console has the log.
    """
    environment = os.environ.get
    home = Path(environment("ROS_HOME") or Path(environment("HOME", "/")) / ".ros")
    folder = Path(environment("ROS_LOG_DIR") or home / "log").expanduser()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return []
    except OSError:
        return ["--ros-args", "--disable-external-lib-logs"]


if __name__ == "__main__":
    sys.exit(main())
