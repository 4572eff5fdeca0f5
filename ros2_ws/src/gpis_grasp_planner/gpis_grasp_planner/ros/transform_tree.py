"""The tree of frames of /tf and /tf_static: poses of frames in each other, by time. No ROS here."""

from __future__ import annotations

import bisect
import threading
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.errors import ErrorCode, PoseError
from gpis_grasp_planner.geometry.transforms import from_position_quat_xyzw, inverse
from gpis_grasp_planner.ros.text import printable

Array = NDArray[np.float64]

KEPT_S = 10.0
MOST_FRAMES = 2000
_MOST_SAMPLES = 5000
_NS = 1_000_000_000
_KEPT_NS = int(KEPT_S * _NS)


@dataclass(eq=False)
class _Edge:
    """Where one frame was in its parent, by time; static ones have one sample."""

    parent: str
    static: bool
    stamps_ns: list[int] = field(default_factory=list)
    positions: list[Array] = field(default_factory=list)
    quats_xyzw: list[Array] = field(default_factory=list)

    def add(self, stamp_ns: int, position: Array, quat_xyzw: Array) -> None:
        # One older than all that would be kept: its publisher's clock went back.
        if self.static or (self.stamps_ns and stamp_ns < self.stamps_ns[-1] - _KEPT_NS):
            self.stamps_ns, self.positions, self.quats_xyzw = [], [], []
        i = bisect.bisect_left(self.stamps_ns, stamp_ns)
        again = i < len(self.stamps_ns) and self.stamps_ns[i] == stamp_ns
        for values, value in zip(self._lists(), (stamp_ns, position, quat_xyzw), strict=True):
            values[i : i + again] = [value]
        newest = self.stamps_ns[-1]
        drop = bisect.bisect_left(self.stamps_ns, newest - _KEPT_NS)
        drop = max(drop, len(self.stamps_ns) - _MOST_SAMPLES)
        for values in self._lists():
            del values[:drop]

    def _lists(self) -> tuple[list[Any], ...]:
        return self.stamps_ns, self.positions, self.quats_xyzw

    def late_by_s(self, stamp_ns: int) -> float:
        """How far a time lies outside what is known [s]: positive after it, negative before."""
        if self.static:
            return 0.0
        if stamp_ns > self.stamps_ns[-1]:
            return (stamp_ns - self.stamps_ns[-1]) / _NS
        return min((stamp_ns - self.stamps_ns[0]) / _NS, 0.0)

    def at(self, stamp_ns: int) -> Array:
        """T_parent_child (4, 4), interpolated; at the nearest end outside of what is known."""
        i = bisect.bisect_left(self.stamps_ns, stamp_ns)
        if self.static or i == 0 or i == len(self.stamps_ns):
            i = min(i, len(self.stamps_ns) - 1)
            return from_position_quat_xyzw(self.positions[i], self.quats_xyzw[i])
        before, after = self.stamps_ns[i - 1], self.stamps_ns[i]
        share = (stamp_ns - before) / (after - before)
        position = (1.0 - share) * self.positions[i - 1] + share * self.positions[i]
        return from_position_quat_xyzw(
            position, _slerp(self.quats_xyzw[i - 1], self.quats_xyzw[i], share)
        )


class TransformTree:
    """Frames and how they lie in each other; may be used from any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._edges: dict[str, _Edge] = {}

    def __len__(self) -> int:
        return len(self._edges)

    def add(
        self,
        parent: str,
        child: str,
        stamp_ns: int,
        position: Array,
        quat_xyzw: Array,
        *,
        static: bool,
    ) -> str | None:
        """Take a transform; what cannot be one is left out.

        Parameters
        ----------
        parent, child : str
            A leading slash is dropped.
        stamp_ns : int
        position : (3,) array [m]
            Of the child's origin in the parent.
        quat_xyzw : (4,) array
        static : bool
            Whether it holds for all times.

        Returns
        -------
        str or None
            Why it was left out.
        """
        parent, child = parent.lstrip("/"), child.lstrip("/")
        position, quat_xyzw = np.asarray(position, float), np.asarray(quat_xyzw, float)
        norm = float(np.linalg.norm(quat_xyzw))
        if not parent or not child or parent == child:
            return f"a transform from '{printable(child, 60)}' to '{printable(parent, 60)}'"
        if not (np.isfinite(position).all() and abs(norm - 1.0) < 1e-2):
            return f"the transform of '{printable(child, 60)}': no rigid transform"
        with self._lock:
            edge = self._edges.get(child)
            if edge is None and len(self._edges) >= MOST_FRAMES:
                return f"'{printable(child, 60)}': there are {MOST_FRAMES} frames already"
            if edge is None or edge.parent != parent or edge.static != static:
                edge = self._edges[child] = _Edge(parent, static)
            edge.add(stamp_ns, position, quat_xyzw / norm)
        return None

    def forget_moving(self) -> None:
        """Forget all transforms but static ones: their stamps are of another time."""
        with self._lock:
            self._edges = {child: edge for child, edge in self._edges.items() if edge.static}

    def knows(self, frame: str) -> bool:
        """Whether a frame was seen in a parent."""
        return frame.lstrip("/") in self._edges

    def newest_stamp_ns(self, frame: str) -> int | None:
        """When a frame was last seen in its parent; None where it was not, or never moves."""
        with self._lock:
            edge = self._edges.get(frame.lstrip("/"))
            return None if edge is None or edge.static else edge.stamps_ns[-1]

    def look_up(self, target: str, source: str, stamp_ns: int, tolerance_s: float) -> Array:
        """T_target_source (4, 4) at a time.

        Parameters
        ----------
        target, source : str
        stamp_ns : int
        tolerance_s : float [s]
            How far the time may lie outside what is known of a frame on the way.

        Raises
        ------
        PoseError
            NO_TRANSFORM where the tree has no path, TRANSFORM_STALE where it has none at that
            time.
        """
        target, source = target.lstrip("/"), source.lstrip("/")
        with self._lock:
            up, down = self._chain(source), self._chain(target)
            common = next((frame for frame in up if frame in down), None)
            if common is None:
                raise self._no_path(target, source, up, down)
            T_common_source = self._product(up[: up.index(common)], stamp_ns, tolerance_s)
            T_common_target = self._product(down[: down.index(common)], stamp_ns, tolerance_s)
        return inverse(T_common_target) @ T_common_source

    def _chain(self, frame: str) -> list[str]:
        """The frame and its ancestors, up to the root, or to the first again in a circle."""
        chain = [frame]
        while (edge := self._edges.get(chain[-1])) is not None and edge.parent not in chain:
            chain.append(edge.parent)
        return chain

    def _product(self, frames: list[str], stamp_ns: int, tolerance_s: float) -> Array:
        T = np.eye(4)
        for frame in frames:
            edge = self._edges[frame]
            late_s = edge.late_by_s(stamp_ns)
            if abs(late_s) > tolerance_s:
                side = "newest" if late_s > 0.0 else "oldest"
                raise PoseError(
                    f"The {side} transform of '{printable(frame, 60)}' on tf is {abs(late_s):.2f} "
                    f"s away from the object pose's stamp; the limit is {tolerance_s:g} s "
                    "(parameter tf_tolerance_s). Compare the clocks, and see whether its "
                    "publisher runs.",
                    ErrorCode.TRANSFORM_STALE,
                )
            T = edge.at(stamp_ns) @ T
        return T

    def _no_path(self, target: str, source: str, up: list[str], down: list[str]) -> PoseError:
        known = set(self._edges) | {edge.parent for edge in self._edges.values()}
        unknown = [frame for frame in (source, target) if frame not in known]
        if unknown:
            why = "tf does not know " + " and ".join(f"'{printable(f, 60)}'" for f in unknown)
        else:
            why = f"they have the roots '{printable(up[-1], 60)}' and '{printable(down[-1], 60)}'"
        return PoseError(
            f"There is no transform from '{printable(source, 60)}' to '{printable(target, 60)}': "
            f"{why}. Publish it on /tf or /tf_static, or give everything in one frame.",
            ErrorCode.NO_TRANSFORM,
        )


def _slerp(first: Array, second: Array, share: float) -> Array:
    """Unit quaternion between two, on the shorter way."""
    cosine = float(first @ second)
    if cosine < 0.0:
        second, cosine = -second, -cosine
    if cosine > 1.0 - 1e-9:
        mixed = (1.0 - share) * first + share * second
    else:
        angle = np.arccos(cosine)
        mixed = np.sin((1.0 - share) * angle) * first + np.sin(share * angle) * second
    return mixed / np.linalg.norm(mixed)
