"""The hands there are: their facts, what is wrong with a description, and a picture."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gpis_grasp_planner.cli import output
from gpis_grasp_planner.cli.exit_codes import ERROR, SUCCESS

if TYPE_CHECKING:
    from gpis_grasp_planner.hand.description import HandDescription

EXAMPLES = """\
examples:
  gpis-grasp hand
  gpis-grasp hand list
  gpis-grasp hand check ./my_hand.yaml
  gpis-grasp hand show parallel_jaw --picture jaw.png
"""
_SHOWN = (0.0, 0.5, 1.0)  # shares of the way of the finger motors


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of 'hand'."""
    parser.add_argument(
        "what",
        nargs="?",
        choices=("facts", "list", "check", "show"),
        default="facts",
        help="facts of a hand (the default), the hands there are, what is wrong with a "
        "description, or a picture of the hand open, half closed and closed",
    )
    parser.add_argument("hand", nargs="?", metavar="HAND", help="name, or the hand's YAML file")
    parser.add_argument("--name", metavar="HAND", help="the same; default: the default hand")
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--urdf", action="store_true", help="print the path of the URDF only")
    form.add_argument(
        "--json", action="store_true", help="print the facts, names, faults or the picture as JSON"
    )
    parser.add_argument(
        "--picture", type=Path, metavar="FILE.png", help="of 'show'; default: HAND.png"
    )


def run(arguments: argparse.Namespace) -> int:
    """Print what was asked for."""
    from gpis_grasp_planner.hand.description import available_hands, load_hand
    from gpis_grasp_planner.hand.settings import DEFAULT_HAND

    _refuse_what_is_not_used(arguments)
    if arguments.what == "list":
        if arguments.json:
            print(json.dumps({"hands": list(available_hands()), "default": DEFAULT_HAND}))
            return SUCCESS
        for name in available_hands():
            print(name + (" (default)" if name == DEFAULT_HAND else ""))
        return SUCCESS
    hand = load_hand(arguments.hand or arguments.name or DEFAULT_HAND)
    if arguments.what == "check":
        return _check(hand, as_json=arguments.json)
    if arguments.what == "show":
        return _draw(hand, arguments.picture, as_json=arguments.json)
    if arguments.urdf:
        print(hand.urdf_path)
        return SUCCESS
    facts = facts_of(hand)
    if arguments.json:
        print(json.dumps(facts, indent=1))
        return SUCCESS
    print(f"{hand.name}: {hand.urdf_path}")
    print("joints [rad, sliding ones m]:")
    for joint in facts["joints"]:
        at = f", open at {joint['open']:.4f}" if joint["open"] else ""
        print(f"  {joint['name']:<16} {joint['lower']:.4f} to {joint['upper']:.4f}{at}")
    print("links (friction of):")
    for link in facts["links"]:
        print(f"  {link['name']:<26} {link['friction_group']}")
    return SUCCESS


def _refuse_what_is_not_used(arguments: argparse.Namespace) -> None:
    """Refuse an option that the action would pass over in silence."""
    from gpis_grasp_planner.errors import RequestError

    what = arguments.what
    named = arguments.hand if arguments.hand is not None else arguments.name
    for given, option, actions in (
        (arguments.picture is not None, "--picture", ("show",)),
        (arguments.urdf, "--urdf", ("facts",)),
        (named is not None, f"hand ('{named}')", ("facts", "check", "show")),
    ):
        if given and what not in actions:
            raise RequestError(f"'hand {what}' takes no {option}: 'hand {actions[0]}' does.")
    if arguments.hand is not None and arguments.name not in (None, arguments.hand):
        raise RequestError(
            f"Two hands are named, '{arguments.hand}' and --name {arguments.name}. Leave one out."
        )


def facts_of(hand: HandDescription) -> dict[str, Any]:
    """What 'hand --json' prints; joints as the URDF counts them."""
    import numpy as np

    ends = hand.joint_count.of_urdf(np.stack([hand.joint_lower, hand.joint_upper]))
    return {
        "name": hand.name,
        "urdf": str(hand.urdf_path),
        "palm_link": hand.palm_link,
        "joints": [
            {
                "name": name,
                "type": "prismatic" if slides else "revolute",
                "lower": float(low),
                "upper": float(high),
                "open": float(zero),
                "velocity": float(speed),
            }
            for name, slides, low, high, zero, speed in zip(
                hand.joint_names,
                hand.joint_slides,
                ends.min(axis=0),
                ends.max(axis=0),
                hand.joint_count.zero,
                hand.joint_velocity,
                strict=True,
            )
        ],
        "links": [
            {"name": name, "friction_group": group}
            for name, group in zip(hand.link_names, hand.link_friction_group, strict=True)
        ],
        "motors": [
            {"name": name, "lower": float(low), "upper": float(high)}
            for name, low, high in zip(
                (*hand.preshape.names, *hand.drive.motor_names),
                hand.motor_lower,
                hand.motor_upper,
                strict=True,
            )
        ],
    }


def _check(hand: HandDescription, *, as_json: bool) -> int:
    """Print the faults of a hand that could be read; what cannot be read was told before."""
    from gpis_grasp_planner.hand.checks import faults_of

    faults = faults_of(hand)
    if as_json:
        print(json.dumps({"name": hand.name, "faults": list(faults)}, indent=1))
        return ERROR if faults else SUCCESS
    for fault in faults:
        output.note(f"gpis-grasp: {fault}")
    if faults:
        return ERROR
    links = sorted({len(finger.links) for finger in hand.fingers})
    print(
        f"{hand.name}: no fault found; {len(hand.fingers)} fingers of "
        f"{' or '.join(map(str, links))} link{'s' if links != [1] else ''}, pre-shape: "
        f"{', '.join(hand.preshape.names) or 'none'}, {hand.n_links} links with "
        f"{sum(map(len, hand.link_collision))} convex pieces."
    )
    for name, back in zip(hand.joint_names, hand.joint_back, strict=True):
        if back < 0.0:
            print(f"  Joint '{name}' could go {-back:g} beyond where the open hand has it.")
    return SUCCESS


def _draw(hand: HandDescription, path: Path | None, *, as_json: bool) -> int:
    import numpy as np

    from gpis_grasp_planner.hand.checks import fingertip_gaps
    from gpis_grasp_planner.hand.drive import joints_from_motors
    from gpis_grasp_planner.view.picture import GraspView, render_sheet

    path = path or Path(f"{hand.yaml_path.stem}.png")
    output.check_picture(path)
    share = np.array(_SHOWN)
    joints = joints_from_motors(
        hand,
        np.tile(hand.preshape.lower, (len(share), 1)),
        share[:, None] * hand.drive.motor_upper,
    )
    gaps = 1e3 * fingertip_gaps(hand, share)
    views = [
        GraspView(
            None, hand, np.eye(4), q, caption=f"closed by {100 * s:.0f} %: {gap:.0f} mm apart"
        )
        for q, s, gap in zip(joints, share, gaps, strict=True)
    ]
    render_sheet(views, path=path, view="auto", columns=len(views))
    print(json.dumps({"picture": str(path), "name": hand.name}) if as_json else path)
    return SUCCESS
