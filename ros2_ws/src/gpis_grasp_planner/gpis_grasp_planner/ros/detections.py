"""Parts in ``vision_msgs/Detection3DArray``: whose estimate is taken of many, and which part it is.

Free of the message package: only the fields of the messages are read.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.geometry.catalogue import ID_PATTERN


def mapping_of(pairs: Iterable[str], name: str) -> dict[str, str]:
    """A mapping from texts ``left=mesh_id``.

    Raises
    ------
    RequestError
        For a pair without "=", a mesh ID that no catalogue can hold, or a left side that stands
        for two of them.
    """
    found: dict[str, str] = {}
    for pair in pairs:
        left, equals, mesh_id = pair.rpartition("=")
        if not equals or not left or ID_PATTERN.fullmatch(mesh_id) is None:
            raise RequestError(
                f"Setting '{name}' has the entry {pair!r:.80}; it takes texts such as "
                "'12=mug': what the estimator says, '=', and a mesh ID."
            )
        if found.setdefault(left, mesh_id) != mesh_id:
            raise RequestError(
                f"Setting '{name}' names {left!r:.60} twice, for '{found[left]:.60}' and for "
                f"'{mesh_id:.60}'. Keep one of them."
            )
    return found


def chosen_instances(
    detections: Iterable[Any],
    mesh_ids: Mapping[str, str],
    min_score: float,
    near: tuple[float, float, float] | None,
) -> dict[str, Any]:
    """One hypothesis with its header for each part that was seen.

    Parameters
    ----------
    detections : iterable of Detection3D
    mesh_ids : mapping
        From class IDs to mesh IDs; a class that is not in it is taken for a mesh ID.
    min_score : float
    near : tuple or None
        The instance nearest to this point [m] is taken, in the frame of the detections; None: that
        with the best score.

    Returns
    -------
    dict of mesh ID to (header, ObjectHypothesisWithPose)
    """
    rank: Callable[[Any], float] = lambda h: -h.hypothesis.score  # noqa: E731
    if near is not None:
        rank = lambda h: _distance(h.pose.pose.position, near)  # noqa: E731
    best: dict[str, tuple[float, Any]] = {}
    for detection in detections:
        for hypothesis in detection.results:
            score = hypothesis.hypothesis.score
            if not score >= min_score:  # NaN is no score
                continue
            class_id = hypothesis.hypothesis.class_id
            mesh_id = mesh_ids.get(class_id, class_id)
            entry = rank(hypothesis), (detection.header, hypothesis)
            if mesh_id not in best or entry[0] < best[mesh_id][0]:
                best[mesh_id] = entry
    return {mesh_id: taken for mesh_id, (_, taken) in best.items()}


def only_a_box(detection: Any) -> bool:
    """Whether a detector has filled in the box alone, and left all poses as they are made.

    Such a pose would be a part in the camera itself.
    """
    center = detection.bbox.center.position
    boxed = (center.x, center.y, center.z) != (0.0, 0.0, 0.0)
    return boxed and not any(_filled_in(result.pose.pose) for result in detection.results)


def _filled_in(pose: Any) -> bool:
    p, q = pose.position, pose.orientation
    return (p.x, p.y, p.z, q.x, q.y, q.z) != (0.0,) * 6


def _distance(position: Any, near: tuple[float, float, float]) -> float:
    distance = math.dist((position.x, position.y, position.z), near)
    return distance if math.isfinite(distance) else math.inf
