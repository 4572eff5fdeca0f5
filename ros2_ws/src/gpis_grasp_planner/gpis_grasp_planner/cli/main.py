"""The command ``gpis-grasp``: planning, looking and measuring without ROS.

Each command is a module with ``add_arguments(parser)`` and ``run(arguments) -> int``; the planner
is imported when a command runs, so that ``--help`` answers at once.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence

from gpis_grasp_planner import __version__
from gpis_grasp_planner.cli import benchmark, cache, hand, meshes, plan, render, settings, verify
from gpis_grasp_planner.cli.exit_codes import ERROR, INTERRUPTED
from gpis_grasp_planner.errors import GraspPlannerError

COMMANDS = {
    "plan": plan,
    "render": render,
    "verify": verify,
    "meshes": meshes,
    "hand": hand,
    "settings": settings,
    "cache": cache,
    "benchmark": benchmark,
}


def parser() -> argparse.ArgumentParser:
    """Return the parser of the whole command."""
    top = argparse.ArgumentParser(
        prog="gpis-grasp",
        description="Plan grasps of CAD parts for a multi-finger hand, without ROS.",
        epilog="Exit codes: 0 done, 1 error, 2 wrong usage, 3 no answer, 130 interrupted.",
    )
    top.add_argument("--version", action="version", version=f"gpis-grasp {__version__}")
    commands = top.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, module in COMMANDS.items():
        text = (module.__doc__ or "").strip().splitlines()[0]
        command = commands.add_parser(name, help=text, description=text)
        module.add_arguments(command)
        command.set_defaults(run=module.run)
    return top


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; the exit code is the return value.

    Errors of the project's tree and of files are one line on stderr, never a traceback.
    """
    words = list(sys.argv[1:] if argv is None else argv)
    arguments = parser().parse_args(words)
    arguments.words = words  # for reports that say how they were made
    try:
        code: int = arguments.run(arguments)
        sys.stdout.flush()
    except GraspPlannerError as error:
        return _fail(str(error))
    except BrokenPipeError:
        # The reader of a pipe has gone (such as `| head`): nothing more to say to it.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return ERROR
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        return _fail(f"{where}{error.strerror or error}")
    except KeyboardInterrupt:
        print("gpis-grasp: interrupted", file=sys.stderr)
        return INTERRUPTED
    return code


def _fail(message: str) -> int:
    print(f"gpis-grasp: error: {message}", file=sys.stderr)
    return ERROR


if __name__ == "__main__":
    sys.exit(main())
