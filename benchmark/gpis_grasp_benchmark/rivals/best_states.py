"""The best states of a walk that are mutually distinct, as the original simulator keeps them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.grasp.order import pose_difference

Array = NDArray[np.float64]


@dataclass(eq=False)
class BestState:
    """A state (dim,), its energy, and the palm face's pose (4, 4)."""

    energy: float
    state: Array
    T_object_face: Array
    closed: bool = False


class BestStates:
    """At most `n` states, each `apart` from the others, lowest energy first.

    A state that is near better ones is not taken; near worse ones it replaces them.
    """

    def __init__(self, max_radius: float, n: int, apart: float):
        self._max_radius = max_radius
        self._n = n
        self._apart = apart
        self.entries: list[BestState] = []

    def __len__(self) -> int:
        return len(self.entries)

    @property
    def worst_energy(self) -> float:
        """Energy that a state has to beat; inf while there is room."""
        return self.entries[-1].energy if len(self.entries) == self._n else np.inf

    def near(self, T_object_face: Array) -> NDArray[np.bool_]:
        """Which entries are nearer to a pose than `apart`."""
        if not self.entries:
            return np.zeros(0, dtype=np.bool_)
        poses = np.stack([entry.T_object_face for entry in self.entries])
        difference = pose_difference(poses, T_object_face, self._max_radius)
        return np.asarray(difference < self._apart)

    def offer(self, energy: float, state: Array, T_object_face: Array) -> bool:
        """Take a state if it is good and distinct enough; returns whether it was taken."""
        if not energy < self.worst_energy:
            return False
        near = self.near(T_object_face)
        if any(entry.energy <= energy for entry, n in zip(self.entries, near, strict=True) if n):
            return False
        self.entries = [entry for entry, n in zip(self.entries, near, strict=True) if not n]
        self.entries.append(BestState(energy, state.copy(), T_object_face.copy()))
        self.entries.sort(key=lambda entry: entry.energy)
        del self.entries[self._n :]
        return True
