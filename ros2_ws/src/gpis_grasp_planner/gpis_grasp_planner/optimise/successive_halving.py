"""Asynchronous successive halving: which of many starts of a local search to go on with.

Every start is searched for a short while; the better part of those that got so far is searched for
longer, the better part of these for longer again. Nobody waits for a rung to be full: a start is
promoted as soon as it is among the better part of what its rung holds by then, and where none is,
a new one is begun. The early value of a start need not tell much of its last one; that the worse
half of a rung hardly ever holds the best is enough.

Source: L. Li et al., "A System for Massively Parallel Hyperparameter Tuning" (ASHA), MLSys 2020,
Algorithm 2, for one worker and with values that are maximised. There a start goes on whenever it is
among the better part, and late good ones make the upper rungs fuller than their share; here a rung
is never given more than one in `ratio` of the one below, and the best of those that wait goes next.
"""

from __future__ import annotations


class SuccessiveHalving:
    """Rungs of a tournament, known by the numbers of the starts in them.

    Parameters
    ----------
    n_rungs : int
        A start that has reached the last rung is not promoted any further.
    ratio : int
        One in `ratio` goes on, with `ratio` times the work.
    """

    def __init__(self, n_rungs: int, ratio: int):
        if n_rungs < 1 or ratio < 2:
            raise ValueError(f"There must be a rung and a ratio over 1, not {n_rungs} and {ratio}.")
        self._ratio = ratio
        self._values: list[dict[int, float]] = [{} for _ in range(n_rungs)]
        self._promoted: list[set[int]] = [set() for _ in range(n_rungs)]

    def turns(self, rung: int) -> int:
        """Turns of work from the rung below to `rung`: ratio^rung in all, 1 to the first."""
        below = self._ratio ** (rung - 1) if rung else 0
        return int(self._ratio**rung) - below

    def promote(self) -> tuple[int, int] | None:
        """The start to go on with and the rung it goes to, highest rung first; None: begin one.

        The start counts as promoted from here on; `report` its value once it has got there.
        """
        for rung in range(len(self._values) - 2, -1, -1):
            values, promoted = self._values[rung], self._promoted[rung]
            due = len(values) // self._ratio
            if len(promoted) >= due:
                continue
            for start in sorted(values, key=lambda start: -values[start])[:due]:
                if start not in promoted:
                    promoted.add(start)
                    return start, rung + 1
        return None

    def report(self, start: int, rung: int, value: float) -> None:
        """Tell the value that a start has on reaching a rung."""
        self._values[rung][start] = value
