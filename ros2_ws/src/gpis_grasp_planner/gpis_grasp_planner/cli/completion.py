"""Print a shell's completion of this command."""

from __future__ import annotations

import argparse
import json
import os

from gpis_grasp_planner.cli.exit_codes import SUCCESS

SHELLS = ("bash", "zsh", "fish")
EXAMPLES = """\
examples:
  eval "$(gpis-grasp completion bash)"           in ~/.bashrc
  eval "$(gpis-grasp completion zsh)"            in ~/.zshrc, after compinit
  gpis-grasp completion fish | source            in ~/.config/fish/config.fish
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the shell."""
    parser.add_argument("shell", choices=SHELLS)
    parser.add_argument("--json", action="store_true", help="print shell and code as JSON")


def run(arguments: argparse.Namespace) -> int:
    """Print the shell's code."""
    from argcomplete.shell_integration import shellcode

    code = shellcode(["gpis-grasp"], shell=arguments.shell)
    print(json.dumps({"shell": arguments.shell, "code": code}) if arguments.json else code)
    return SUCCESS


def complete(parser: argparse.ArgumentParser) -> None:
    """Answer the shell and end the process, where the shell has called for a completion."""
    if "_ARGCOMPLETE" in os.environ:
        import argcomplete

        argcomplete.autocomplete(parser)


def mesh_ids(parsed_args: argparse.Namespace, **_: object) -> list[str]:
    """IDs of the catalogue, for the argument MESH; the shell completes files beside them."""
    from gpis_grasp_planner.cli.options import catalogue_of

    return catalogue_of(getattr(parsed_args, "meshes", None)).ids()


def hand_names(**_: object) -> list[str]:
    """The hands there are, for --hand; the shell completes files beside them."""
    from gpis_grasp_planner.hand.description import available_hands

    return list(available_hands())


def constraint_names(**_: object) -> list[str]:
    """What installed distributions register, for --constraint."""
    from gpis_grasp_planner.plan.own_constraints import GROUP
    from gpis_grasp_planner.registered import registered

    return list(registered(GROUP))


def setting_names(**_: object) -> list[str]:
    """``group.name=`` of every setting, for --set."""
    from gpis_grasp_planner.cli.options import setting_classes
    from gpis_grasp_planner.settings import describe

    return [
        f"{group}.{info.name}="
        for group, settings in setting_classes().items()
        for info in describe(settings)
    ]
