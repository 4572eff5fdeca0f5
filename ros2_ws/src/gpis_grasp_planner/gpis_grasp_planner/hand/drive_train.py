"""Motors, forces and the closing table of a hand, as its YAML file says them (docs/hands.md)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.errors import RequestError

Array = NDArray[np.float64]

_TOLERANCE = 1e-6


@dataclass(frozen=True, eq=False)
class Drive:
    """Motors and gears; motors are ordered spread, then one per finger.

    Finger motors' angles are given as the first joint's angle they give while nothing touches, in
    metres where that joint slides. A hand without a spread has 0 to 0 there.

    Attributes
    ----------
    motor_names : tuple of str
    motor_lower, motor_upper, motor_speed : (1 + F,) arrays [rad, rad, rad/s]
    closing_ratio : (D, D) array
        Row h: each joint's motion per motion of joint h, the first that is free, while the h
        joints before it are held. Before its breakaway a Barrett finger has (1, 1/3), after it the
        distal joint moves alone.
    advances_at_stop : bool
        Whether a joint that comes to its stop is held there, and the next row goes on; else the
        finger ends.
    self_locking : bool
        Whether a joint that is pushed back stands still; else its motor presses back with the
        holding force.
    independent : bool
        Each joint has a motor of its own: it presses and holds with its effort at most, and one
        that is held stands where it was.
    coupled : bool
        One motor moves all fingers by the same amount (docs/hands.md).
    breakaway_torque : float [N m]
        At which a link that touches is held, and the next row goes on.
    tip_force_n, holding_force_n : float [N] or None
        With which a fingertip presses, and up to which it is not driven back; None leaves both to
        the settings.
    tip_point : (3,) array [m]
        Where a fingertip presses, in the outermost link's frame.
    """

    motor_names: tuple[str, ...]
    motor_lower: Array
    motor_upper: Array
    motor_speed: Array
    closing_ratio: Array
    advances_at_stop: bool
    self_locking: bool
    independent: bool
    coupled: bool
    breakaway_torque: float
    tip_force_n: float | None
    holding_force_n: float | None
    tip_point: Array

    @property
    def n_links(self) -> int:
        """Links of each finger that closing moves, D."""
        return len(self.closing_ratio)

    @property
    def row_travel(self) -> Array:
        """Sum of the joints' motions per motion of the first free one, per row (D,).

        A motor pulls on all joints alike, so that this is what it does for the row.
        """
        return np.asarray(self.closing_ratio.sum(axis=1))

    @property
    def row_gear(self) -> Array:
        """Motion of the motor per motion of the first free joint, per row (D,); 1 at first."""
        return np.asarray(self.row_travel / self.row_travel[0])


def read_drive(data: Mapping[str, Any], n_links: int) -> Drive:
    """The drive of fingers of `n_links` links from its part of the YAML file.

    Raises
    ------
    RequestError
        If the closing table does not fit the fingers.
    """
    if "motor_upper_mm" in data:
        upper = np.array(data["motor_upper_mm"], dtype=float) / 1000.0
    else:
        upper = np.radians(np.array(data["motor_upper_deg"], dtype=float))
    forces = [data.get(name) for name in ("tip_force_n", "holding_force_n")]
    return Drive(
        motor_names=tuple(data["motor_names"]),
        motor_lower=np.zeros_like(upper),
        motor_upper=upper,
        motor_speed=upper / np.array(data["full_travel_s"], dtype=float),
        closing_ratio=_closing_ratio(data, n_links),
        advances_at_stop=bool(data.get("advances_at_stop", False)),
        self_locking=bool(data.get("self_locking", False) or data.get("independent", False)),
        independent=bool(data.get("independent", False)),
        coupled=bool(data.get("coupled", False)),
        breakaway_torque=float(data.get("breakaway_torque", 0.0)),
        tip_force_n=None if forces[0] is None else float(forces[0]),
        holding_force_n=None if forces[1] is None else float(forces[1]),
        tip_point=np.array(data["tip_point_mm"], dtype=float) / 1000.0,
    )


def check_limits(name: str, drive: Drive, joint_upper: Array) -> None:
    """Refuse a table by which a joint would run into its stop while one before it leads.

    Where it would be, its motor's angle would not tell where the joints are.

    Parameters
    ----------
    name : str
        The hand's.
    drive : Drive
    joint_upper : (F, D) array [rad]
        Upper limits of the joints that close.

    Raises
    ------
    RequestError
    """
    table = drive.closing_ratio
    for upper, motor in zip(joint_upper, drive.motor_upper[1:], strict=True):
        # while joint h leads it, and links before are held anywhere
        for h in range(len(table)):
            for k in range(h + 1, len(table)):
                reached = _farthest(table[: h + 1], upper, motor * drive.row_travel[0], k)
                if reached > upper[k] + _TOLERANCE:
                    raise RequestError(
                        f"By row {h + 1} of the closing table of '{name}' joint {k + 1} of a "
                        f"finger would go to {reached:.4f}, but its stop is at {upper[k]:.4f}; "
                        "lower its ratio or raise its limit."
                    )


def _farthest(rows: Array, upper: Array, travel: float, k: int) -> float:
    """Where joint k comes at most by rows (h + 1, D) whose leading joints keep their limits."""
    if len(rows) == 1:
        return float(rows[0, k] * min(upper[0], travel / rows[0].sum()))
    from scipy.optimize import linprog  # half a second, for closing tables of several rows alone

    n = len(rows)
    lead = rows[:, :n].T  # joint i's position is lead[i] @ ways
    best = linprog(
        -rows[:, k],
        A_ub=np.vstack([lead, rows.sum(axis=1)]),
        b_ub=np.append(upper[:n], travel),
        bounds=[(0.0, None)] * n,
    )
    return float(rows[:, k] @ np.asarray(best.x, dtype=float))


def _closing_ratio(data: Mapping[str, Any], n_links: int) -> Array:
    table = np.eye(n_links)
    if "closing_rows" in data:
        table = np.array(data["closing_rows"], dtype=float)
        if table.shape != (n_links, n_links):
            raise RequestError(
                f"'closing_rows' has the shape {table.shape}; fingers of {n_links} links need "
                f"{n_links} rows of {n_links} numbers."
            )
        if (table < 0.0).any() or np.tril(table, -1).any() or (np.diag(table) != 1.0).any():
            raise RequestError(
                "Row h of 'closing_rows' must have 0 for the joints before h, 1 for joint h, and "
                f"0 or more for those after it; it is {table.tolist()}."
            )
    elif "motor_to_distal" in data:
        table[0, 1:] = data["motor_to_inner"] / data["motor_to_distal"]
    elif n_links > 1:
        raise RequestError(
            f"Fingers of {n_links} links need 'closing_rows', or 'motor_to_inner' and "
            "'motor_to_distal', in 'drive'."
        )
    return table
