"""Facts of the hand, or the path of its URDF."""

from __future__ import annotations

import argparse
import json
from typing import Any

from gpis_grasp_planner.cli.exit_codes import SUCCESS


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of 'hand'."""
    parser.add_argument("--name", metavar="HAND", help="default: the default hand")
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--urdf", action="store_true", help="print the path of the URDF only")
    form.add_argument("--json", action="store_true", help="print the facts as JSON")


def run(arguments: argparse.Namespace) -> int:
    """Print what was asked for."""
    from gpis_grasp_planner.hand.description import DEFAULT_HAND, load_hand

    hand = load_hand(arguments.name or DEFAULT_HAND)
    if arguments.urdf:
        print(hand.urdf_path)
        return SUCCESS
    facts: dict[str, Any] = {
        "name": hand.name,
        "urdf": str(hand.urdf_path),
        "palm_link": hand.palm_link,
        "joints": [
            {"name": name, "lower": float(low), "upper": float(high), "velocity": float(speed)}
            for name, low, high, speed in zip(
                hand.joint_names, hand.joint_lower, hand.joint_upper, hand.joint_velocity,
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
                hand.drive.motor_names, hand.drive.motor_lower, hand.drive.motor_upper, strict=True
            )
        ],
    }  # fmt: skip
    if arguments.json:
        print(json.dumps(facts, indent=1))
        return SUCCESS
    print(f"{hand.name}: {hand.urdf_path}")
    print("joints [rad]:")
    for joint in facts["joints"]:
        print(f"  {joint['name']:<14} {joint['lower']:.4f} to {joint['upper']:.4f}")
    print("links (friction of):")
    for link in facts["links"]:
        print(f"  {link['name']:<26} {link['friction_group']}")
    return SUCCESS
