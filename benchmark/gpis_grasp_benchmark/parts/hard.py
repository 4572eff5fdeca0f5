"""Make the set of hard parts: ``python -m gpis_grasp_benchmark.parts.hard DIRECTORY``.

Twelve classes of thin, long, flat and small parts in several sizes each. Every part becomes a
binary STL in millimetres and a YAML file; its class is the first word of its name.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from gpis_grasp_benchmark.parts import thin
from gpis_grasp_benchmark.parts.generate import Recipe, write_all
from gpis_grasp_benchmark.parts.long_edges import halved
from gpis_grasp_benchmark.parts.solids import Solid

Sizes = tuple[tuple[object, ...], ...]
_SHAPES: dict[str, tuple[Callable[..., Solid], str, Sizes]] = {
    "rod": (thin.rod, "steel", ((6, 80), (8, 200), (10, 120), (16, 160), (25, 200), (32, 260))),
    "shaft": (
        thin.shaft,
        "steel",
        (
            ((8, 14, 10), (30, 40, 30)),
            ((12, 20, 28, 16), (40, 30, 40, 50)),
            ((20, 30, 20), (60, 20, 60)),
            ((10, 16, 10, 6), (50, 60, 40, 30)),
            ((30, 40, 25), (50, 60, 70)),
        ),
    ),
    "key": (thin.hexagon_key, "steel", ((3, 63, 20), (5, 80, 28), (8, 100, 36), (12, 137, 50))),
    "screwdriver": (
        thin.screwdriver,
        "plastic",
        ((22, 70, 4, 75), (28, 95, 6, 100), (32, 105, 8, 150), (36, 115, 10, 175), (18, 60, 3, 50)),
    ),
    "cutlery": (
        thin.knife,
        "steel",
        ((210, 20, 2.5), (170, 16, 2.0), (240, 28, 3.0)),
    ),
    "spoon": (thin.spoon, "steel", ((190, 40, 2.0), (140, 30, 1.6), (260, 60, 2.5))),
    "plate": (
        thin.plate,
        "aluminium",
        ((80, 60, 2), (100, 100, 5), (150, 100, 3), (200, 120, 8), (160, 40, 4), (120, 120, 12)),
    ),
    "panel": (
        thin.drilled_plate,
        "steel",
        ((90, 60, 3), (140, 90, 5), (180, 60, 6), (110, 110, 8)),
    ),
    "bracket": (
        thin.bracket,
        "steel",
        ((40, 40, 30, 2), (60, 50, 50, 2), (80, 60, 40, 3), (100, 80, 80, 3), (50, 90, 25, 2)),
    ),
    "angle": (
        thin.l_profile,
        "aluminium",
        ((20, 2, 100), (30, 3, 180), (40, 4, 140), (50, 5, 220), (25, 3, 60)),
    ),
    "channel": (
        thin.u_profile,
        "aluminium",
        ((20, 2, 100), (30, 3, 160), (40, 3, 200), (50, 5, 120)),
    ),
    "ring": (
        thin.ring,
        "steel",
        ((40, 24, 6), (60, 50, 8), (90, 70, 12), (120, 100, 10), (30, 16, 12)),
    ),
    "disc": (thin.disc, "steel", ((40, 4), (60, 10), (90, 6), (120, 12), (150, 8))),
    "block": (
        thin.small_block,
        "aluminium",
        ((10, 10, 10), (15, 15, 15), (20, 20, 20), (30, 20, 10), (40, 25, 15), (25, 25, 60)),
    ),
    "pin": (thin.pin, "steel", ((4, 20), (6, 30), (8, 40), (10, 60), (12, 30))),
}
EDGE_MM = 12.0


def _name(shape: str, size: Sequence[object]) -> str:
    flat = [
        f"{number:g}"
        for value in size
        for number in (value if isinstance(value, tuple) else (value,))
        if isinstance(number, int | float)
    ]
    return f"{shape}_{'x'.join(flat)}".replace(".", "p")


def recipes() -> tuple[Recipe, ...]:
    """All parts of the set."""
    return tuple(
        Recipe(
            partial(build, *size), material, EDGE_MM, _name(shape, size), _described(build), halved
        )
        for shape, (build, material, sizes) in _SHAPES.items()
        for size in sizes
    )


def class_of(name: str) -> str:
    """The class that a part's name begins with."""
    return name.partition("_")[0]


def _described(build: Callable[..., Solid]) -> str:
    return (build.__doc__ or "").splitlines()[0]


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of the command."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("directory", type=Path)
    write_all(parser.parse_args(arguments).directory, recipes())


if __name__ == "__main__":
    main()
