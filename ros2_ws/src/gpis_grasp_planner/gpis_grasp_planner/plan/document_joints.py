"""How the joints of a document's hand are counted (`hand.open_hand`)."""

from __future__ import annotations

import numpy as np

from gpis_grasp_planner.hand.open_hand import JointCount
from gpis_grasp_planner.plan.json_node import Node


def read_joint_count(node: Node, n: int) -> JointCount:
    """That of `n` joints; earlier documents have none: their hands' joints were 0 when open."""
    if node.value is None:
        return JointCount(np.zeros(n), np.ones(n))
    entry = node.object(frozenset({"zero", "sense"}))
    sense = entry["sense"].vector(n)
    if not (np.abs(sense) == 1.0).all():
        raise entry["sense"].fail("numbers that are 1 or -1")
    return JointCount(entry["zero"].vector(n), sense)
