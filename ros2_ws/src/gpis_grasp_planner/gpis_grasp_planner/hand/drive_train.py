"""Motors, forces and the closing table of a hand, as its YAML file says them (docs/hands.md)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.errors import RequestError

Array = NDArray[np.float64]

_TOLERANCE = 1e-6
_ROUNDING = 1e-3  # of a limit


@dataclass(frozen=True, eq=False)
class Drive:
    """The motors that close the fingers, one each, and their gears.

    A motor's angle is given as the first joint's angle it gives while nothing touches, in metres
    where that joint slides.

    Attributes
    ----------
    motor_names : tuple of str
    motor_lower, motor_upper, motor_speed : (F,) arrays [rad, rad, rad/s]
    closing_ratio : (F, D, D) array
        Of each finger, row h: each joint's motion per motion of joint h, the first that is free,
        while the h joints before it are held. Before its breakaway a Barrett finger has (1, 1/3),
        after it the distal joint moves alone. A finger of fewer links has its own table at the
        end, and before it joints that move nothing.
    row_travel : (F, D) array
        Sum of the joints' motions per motion of the first free one. A motor pulls on all joints
        alike, so that this is what it does for the row.
    first_travel : (F,) array
        That of each finger's own first row.
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
    """

    motor_names: tuple[str, ...]
    motor_lower: Array
    motor_upper: Array
    motor_speed: Array
    closing_ratio: Array
    row_travel: Array
    first_travel: Array
    advances_at_stop: bool
    self_locking: bool
    independent: bool
    coupled: bool
    breakaway_torque: float
    tip_force_n: float | None
    holding_force_n: float | None

    @property
    def n_links(self) -> int:
        """Links that closing moves of the finger that has most, D."""
        return int(self.closing_ratio.shape[1])

    @property
    def row_gear(self) -> Array:
        """Motion of the motor per motion of the first free joint, (F, D); 1 in the first row."""
        return np.asarray(self.row_travel / self.first_travel[:, None])


def read_drive(data: Mapping[str, Any], tables: Sequence[Array]) -> Drive:
    """The drive from its part of the YAML file and the fingers' closing tables (n, n)."""
    if "motor_upper_mm" in data:
        upper = np.array(data["motor_upper_mm"], dtype=float) / 1000.0
    else:
        upper = np.radians(np.array(data["motor_upper_deg"], dtype=float))
    forces = [data.get(name) for name in ("tip_force_n", "holding_force_n")]
    most = max(len(table) for table in tables)
    padded = np.tile(np.eye(most), (len(tables), 1, 1))
    for whole, table in zip(padded, tables, strict=True):
        whole[most - len(table) :, most - len(table) :] = table
    return Drive(
        motor_names=tuple(data["motor_names"]),
        motor_lower=np.zeros_like(upper),
        motor_upper=upper,
        motor_speed=upper / np.array(data["full_travel_s"], dtype=float),
        closing_ratio=padded,
        row_travel=padded.sum(axis=2),
        first_travel=np.array([table[0].sum() for table in tables]),
        advances_at_stop=bool(data.get("advances_at_stop", False)),
        self_locking=bool(data.get("self_locking", False) or data.get("independent", False)),
        independent=bool(data.get("independent", False)),
        coupled=bool(data.get("coupled", False)),
        breakaway_torque=float(data.get("breakaway_torque", 0.0)),
        tip_force_n=None if forces[0] is None else float(forces[0]),
        holding_force_n=None if forces[1] is None else float(forces[1]),
    )


def closing_table(data: Mapping[str, Any], own: Mapping[str, Any], n_links: int) -> Array:
    """Closing table (n, n) of a finger: of its own entry, or by the drive for all fingers.

    Raises
    ------
    RequestError
        If there is none, or it does not fit the finger.
    """
    rows = own["closing_rows"] if "closing_rows" in own else data.get("closing_rows")
    table = np.eye(n_links)
    if rows is not None:
        table = np.array(rows, dtype=float)
        if table.shape != (n_links, n_links):
            raise RequestError(
                f"'closing_rows' has the shape {table.shape}; a finger of {n_links} links needs "
                f"{n_links} rows of {n_links} numbers. One that differs from the others has "
                "'closing_rows' in its own entry."
            )
        if (table < 0.0).any() or np.tril(table, -1).any() or (np.diag(table) != 1.0).any():
            raise RequestError(
                "Row h of 'closing_rows' must have 0 for the joints before h, 1 for joint h, and "
                f"0 or more for those after it; it is {table.tolist()}. Joints are counted the way "
                "they close: 'closes_towards' turns one that goes back."
            )
    elif "motor_to_distal" in data:
        table[0, 1:] = data["motor_to_inner"] / data["motor_to_distal"]
    elif n_links > 1:
        raise RequestError(
            f"Fingers of {n_links} links need 'closing_rows', or 'motor_to_inner' and "
            "'motor_to_distal', in 'drive'."
        )
    return table


def check_limits(name: str, table: Array, upper: Array, motor: float) -> None:
    """Refuse a table by which a joint would run into its stop while one before it leads.

    Where it would be, its motor's angle would not tell where the joints are.

    Parameters
    ----------
    name : str
        The finger's and the hand's.
    table : (n, n) array
        The finger's closing table.
    upper : (n,) array [rad]
        Upper limits of its joints.
    motor : float [rad]
        And of its motor.

    Raises
    ------
    RequestError
    """
    for h, k, reached in _reached(table, upper, motor):
        if reached > upper[k] + _TOLERANCE:
            raise RequestError(
                f"By row {h + 1} of the closing table of {name} joint {k + 1} would go to "
                f"{reached:.6g}, but its stop is at {upper[k]:.6g}; lower its ratio or raise "
                "its limit."
            )


def rounded_limits(table: Array, upper: Array, motor: float) -> Array:
    """Upper limits (n,) of a finger's joints, a few digits of rounding in the URDF made good.

    Makers give ratios and limits to some digits, by which a joint that follows another stops up to
    a thousandth before that does. Parameters as of :func:`check_limits`.
    """
    limits = np.array(upper, dtype=float)
    for _, k, reached in _reached(table, upper, motor):
        if upper[k] + _TOLERANCE < reached <= upper[k] * (1.0 + _ROUNDING):
            limits[k] = max(limits[k], reached)
    return limits


def _reached(table: Array, upper: Array, motor: float) -> Iterator[tuple[int, int, float]]:
    """Row h, joint k after it, and how far that comes, wherever the links before are held."""
    for h in range(len(table)):
        for k in range(h + 1, len(table)):
            yield h, k, _farthest(table[: h + 1], upper, motor * table[0].sum(), k)


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
