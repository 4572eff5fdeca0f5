"""Units of length of mesh files, and the advice where the size of a part says one is wrong."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gpis_grasp_planner.errors import ErrorCode, MeshError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from gpis_grasp_planner.geometry.catalogue_settings import CatalogueSettings

UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "inch": 0.0254, "in": 0.0254}
_NAMES = {"m": "metres", "mm": "millimetres"}
_RARE = {"cm": "centimetres", "inch": "inches"}


def known_units() -> str:
    """The units as a list in words."""
    return "m, cm, mm, um, inch (or in)"


def metres_per(unit: str, name: str) -> float:
    """Length [m] of a unit; `name` is what messages call the file.

    Raises
    ------
    MeshError
        MESH_SIDECAR_INVALID for a unit that is not known.
    """
    if unit not in UNITS:
        raise MeshError(
            f"{name}: the unit is {unit!r}; it must be one of {known_units()}.",
            ErrorCode.MESH_SIDECAR_INVALID,
        )
    return UNITS[unit]


def same_unit(first: str, second: str) -> bool:
    """Whether two units are one, such as 'in' and 'inch'."""
    return UNITS.get(first, first) == UNITS.get(second, second)


def unit_advice(unit: str) -> str:
    """How to give the unit of a file, for whoever reads the message."""
    return f"give the unit (--unit {unit}, or 'unit: {unit}' in its YAML file)"


def check_extent(
    points: NDArray[np.float64], name: str, unit: str, settings: CatalogueSettings
) -> None:
    """Refuse a part whose largest extent is implausible, with its measures and the likely cure.

    Parameters
    ----------
    points : (n, 3) array [m]
    name : str
        What messages call the file.
    unit : str
        The unit that the file was read in, or 'its own unit'.
    settings : CatalogueSettings
    """
    extent = points.max(axis=0) - points.min(axis=0)
    largest = float(extent.max())
    low, high = settings.min_extent_m, settings.max_extent_m
    if low <= largest <= high:
        return
    size = " x ".join(f"{e:.4g}" for e in extent)
    raise MeshError(
        f"{name} measures {size} m (read in {unit}); the largest extent must be "
        f"{low:g} to {high:g} m. {_cure(largest, unit, low, high)}",
        ErrorCode.MESH_EXTENT_IMPLAUSIBLE,
    )


def _cure(largest: float, unit: str, low: float, high: float) -> str:
    if unit in UNITS:

        def fits(other: str) -> bool:
            size = largest * UNITS[other] / UNITS[unit]
            return not same_unit(other, unit) and low <= size <= high

        for other, name in _NAMES.items():
            if fits(other):
                return f"The file is probably in {name}: {unit_advice(other)}."
        if rare := [other for other in _RARE if fits(other)]:
            return (
                f"The file is probably in {' or '.join(_RARE[u] for u in rare)}: "
                f"{unit_advice(' or '.join(rare))}."
            )
    elif low <= largest / 1000.0 <= high:
        return "Its numbers are probably millimetres: give 'scale: 0.001' in its YAML file."
    if largest < low and low <= largest * 1000.0 <= high:
        return "It was probably scaled from millimetres to metres twice: check the export."
    return "Check the scale of the export, or give 'scale' in its YAML file."
