"""The command ``gpis-grasp``: planning, looking and measuring without ROS.

Each command is a module with ``add_arguments(parser)`` and ``run(arguments) -> int``; the planner
is imported when a command runs, so that ``--help`` answers at once.
"""

from __future__ import annotations

import argparse
import os
import sys
import traceback
from collections.abc import Sequence

from gpis_grasp_planner import __version__
from gpis_grasp_planner.cli import (
    cache,
    completion,
    hand,
    meshes,
    plan,
    plan_all,
    render,
    settings,
    store,
    verify,
    view,
    worker,
)
from gpis_grasp_planner.cli.exit_codes import ERROR, INTERRUPTED, MEANINGS
from gpis_grasp_planner.cli.parser import CommandParser, add_common
from gpis_grasp_planner.errors import GraspPlannerError

COMMANDS = {
    "plan": plan,
    "plan-all": plan_all,
    "worker": worker,
    "render": render,
    "verify": verify,
    "view": view,
    "meshes": meshes,
    "hand": hand,
    "settings": settings,
    "store": store,
    "cache": cache,
    "completion": completion,
}
_FIRST_STEPS = """\
examples:
  gpis-grasp meshes                       which parts there are
  gpis-grasp plan mug                     plan grasps of one of them
  gpis-grasp plan ./part.stl --unit mm    plan grasps of your own part
  gpis-grasp plan --help                  options and more examples
"""


def parser() -> argparse.ArgumentParser:
    """Return the parser of the whole command."""
    codes = "\n".join(f"  {code:<3} {meaning}" for code, meaning in MEANINGS.items())
    top = CommandParser(
        prog="gpis-grasp",
        description="Plan grasps of CAD parts for a multi-finger hand, without ROS.",
        epilog=f"{_FIRST_STEPS}\nexit codes:\n{codes}",
    )
    top.add_argument("--version", action="version", version=f"gpis-grasp {__version__}")
    add_common(top)
    commands = top.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, module in COMMANDS.items():
        text = (module.__doc__ or "").strip().splitlines()[0]
        command = commands.add_parser(
            name, help=text, description=text, epilog=getattr(module, "EXAMPLES", None)
        )
        module.add_arguments(command)
        add_common(command)
        command.set_defaults(run=module.run)
    return top


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; the exit code is the return value.

    Errors are one line on stderr; with --debug after their traceback.
    """
    return run_command(parser(), argv)


def run_command(reader: argparse.ArgumentParser, argv: Sequence[str] | None = None) -> int:
    """Parse, run what the parser's `run` says, and turn its errors into lines and exit codes."""
    words = list(sys.argv[1:] if argv is None else argv)
    completion.complete(reader)
    arguments = reader.parse_args(words)
    arguments.words = words  # for reports that say how they were made
    try:
        code: int = arguments.run(arguments)
        sys.stdout.flush()
    except BrokenPipeError:
        # The reader of a pipe has gone (such as `| head`): nothing more to say to it.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return ERROR
    except KeyboardInterrupt:
        print(f"{reader.prog}: interrupted", file=sys.stderr)
        return INTERRUPTED
    except Exception as error:
        if getattr(arguments, "debug", False):
            traceback.print_exc()
        print(f"{reader.prog}: error: {_said(error)}", file=sys.stderr)
        return ERROR
    return code


def _said(error: Exception) -> str:
    """An error in one line; one that is not foreseen says how to see more of it."""
    if isinstance(error, GraspPlannerError):
        return " ".join(str(error).split())
    if isinstance(error, OSError):
        where = f"{error.filename}: " if error.filename else ""
        return f"{where}{error.strerror or error}."
    what = " ".join(f"{type(error).__name__}: {error}".split())
    return (
        f"{what}. This is a fault of the program: repeat the command with --debug and report what "
        "it shows."
    )


if __name__ == "__main__":
    sys.exit(main())
