"""The hands that a search closes, recorded where the evaluator is asked."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

# Evaluator, palm poses (B, 4, 4), postures (B, J) from which the hands close.
Recorded = list[tuple[Any, np.ndarray, np.ndarray]]


@contextmanager
def recording(evaluator_class: type) -> Iterator[Recorded]:
    """Whatever evaluators of the class are asked to close meanwhile, a list that grows."""
    recorded: Recorded = []

    def recorder(method: Callable[..., Any], from_posture: bool) -> Callable[..., Any]:
        def call(self: Any, T: np.ndarray, how: np.ndarray) -> Any:
            start = np.array(how) if from_posture else np.zeros((len(T), self.hand.n_joints))
            if not from_posture:
                self.hand.preshape.put(start, how)
            recorded.append((self, np.array(T), start))
            return method(self, T, how)

        return call

    methods = {name: getattr(evaluator_class, name) for name in ("attempt", "attempt_from")}
    for name, method in methods.items():
        setattr(evaluator_class, name, recorder(method, name == "attempt_from"))
    try:
        yield recorded
    finally:
        for name, method in methods.items():
            setattr(evaluator_class, name, method)
