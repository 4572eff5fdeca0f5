"""How good a grasp is, as a colour: what physics said of it comes before any figure."""

from __future__ import annotations

from std_msgs.msg import ColorRGBA

from gpis_grasp_msgs.msg import Grasp

NOT_TRIED = (0.45, 0.47, 0.50)
FELL = (0.80, 0.10, 0.10)
DOUBTFUL = (0.95, 0.65, 0.10)
HELD = (0.15, 0.65, 0.25)


def probability_to_hold(grasp: Grasp) -> float | None:
    """The probability that ranks it: over the pose's covariance, else by trials; None: unknown."""
    for probability in (grasp.hold_probability, grasp.verification.probability):
        if probability >= 0.0:
            return float(probability)
    return None


def quality_color(grasp: Grasp, alpha: float = 1.0) -> ColorRGBA:
    """Grey where nothing is known, red where it fell, else from amber (0.5) to green (1).

    Below a probability of 0.5 it goes on from amber to red.
    """
    trials, probability = grasp.verification, probability_to_hold(grasp)
    if trials.attempted and not trials.held:
        color = FELL
    elif probability is None:
        color = HELD if trials.attempted else NOT_TRIED
    elif probability < 0.5:
        color = _between(FELL, DOUBTFUL, 2.0 * probability)
    else:
        color = _between(DOUBTFUL, HELD, 2.0 * probability - 1.0)
    r, g, b = color
    return ColorRGBA(r=r, g=g, b=b, a=alpha)


def quality_text(grasp: Grasp) -> str:
    """Mesh, epsilon and what is known of its holding, in one line."""
    trials, probability = grasp.verification, probability_to_hold(grasp)
    words = [f"{grasp.mesh_id}: epsilon {grasp.epsilon:.3f}"]
    if probability is not None:
        words.append(f"P(hold) {probability:.2f}")
    words.append(("held" if trials.held else "fell") if trials.attempted else "not tried")
    return ", ".join(words)


def _between(
    a: tuple[float, float, float], b: tuple[float, float, float], share: float
) -> tuple[float, float, float]:
    share = min(max(share, 0.0), 1.0)
    r, g, b_ = ((1.0 - share) * x + share * y for x, y in zip(a, b, strict=True))
    return r, g, b_
