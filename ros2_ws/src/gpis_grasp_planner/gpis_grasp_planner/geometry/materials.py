"""Materials a sidecar may name: density, and friction against the hand's links.

Friction of glass, plastic and wood is what the paper's simulations used for the Barrett hand
(its finger links count as wood, its palm as plastic). The others are usual handbook values for
dry contact; a part that matters deserves measured ones in its sidecar.
"""

from __future__ import annotations

from dataclasses import dataclass

from gpis_grasp_planner.geometry.part import Friction


@dataclass(frozen=True)
class Material:
    """Density [kg/m^3] and Coulomb friction of a material."""

    density: float
    friction: Friction


MATERIALS: dict[str, Material] = {
    "abs": Material(1050.0, Friction(0.4, 0.3)),
    "aluminium": Material(2700.0, Friction(0.3, 0.2)),
    "brass": Material(8500.0, Friction(0.3, 0.2)),
    "bronze": Material(8800.0, Friction(0.3, 0.2)),
    "cast_iron": Material(7200.0, Friction(0.3, 0.2)),
    "ceramic": Material(2400.0, Friction(0.3, 0.2)),
    "glass": Material(2500.0, Friction(0.3, 0.2)),
    "plastic": Material(1100.0, Friction(0.4, 0.3)),
    "rubber": Material(1100.0, Friction(1.0, 1.0)),
    "steel": Material(7850.0, Friction(0.3, 0.2)),
    "wood": Material(700.0, Friction(0.4, 0.4)),
}
