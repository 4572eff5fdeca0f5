"""The page about a catalogue that was planned: a table, pictures, and why parts have no grasp."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING
from urllib.parse import quote

if TYPE_CHECKING:
    from gpis_grasp_planner.batch.outcome import Outcome

_STYLE = """\
body { font-family: sans-serif; margin: 2em; max-width: 75em }
table { border-collapse: collapse }
td, th { padding: .25em .8em; text-align: right; border-bottom: 1px solid #ddd }
td.text, th.text { text-align: left }
tr.none td { background: #fbeaea }
figure { display: inline-block; margin: .5em; width: 16em; vertical-align: top }
figure img { width: 100% }
code { background: #f2f2f2 }
"""


def page(
    found: Sequence[Outcome],
    refused: Sequence[tuple[str, str]],
    left: int,
    spent_s: float,
    command: str,
) -> str:
    """The page as HTML; pictures lie in the folder 'pictures' beside it.

    Parameters
    ----------
    found : sequence of Outcome
    refused : sequence of (file, reason)
        Files that no ID can name.
    left : int
        Parts that were not begun or not finished.
    spent_s : float [s]
    command : str
        How it was made.
    """
    with_grasp = sum(outcome.found for outcome in found)
    lines = [
        "<!DOCTYPE html>",
        '<html lang="en"><head><meta charset="utf-8"><title>Planned parts</title>',
        f"<style>{_STYLE}</style></head><body>",
        "<h1>Planned parts</h1>",
        f"<p>{len(found)} parts in {spent_s:.0f} s, {with_grasp} with grasps"
        + (f"; {left} left" if left else "")
        + f". <code>{escape(command)}</code></p>",
        '<table><tr><th class="text">mesh ID</th><th>grasps</th><th>best epsilon</th>'
        '<th>held of tried</th><th>s</th><th class="text">plan</th>'
        '<th class="text">state</th></tr>',
        *map(_row, found),
        "</table>",
    ]
    failures = [(o.mesh_id, f"{o.code}: {o.message}") for o in found if not o.found]
    failures += list(refused)
    if failures:
        lines += ["<h2>Without grasps</h2>", "<dl>"]
        lines += [f"<dt>{escape(name)}</dt><dd>{escape(why)}</dd>" for name, why in failures]
        lines.append("</dl>")
    drawn = [outcome for outcome in found if outcome.picture]
    if drawn:
        lines += ["<h2>Best grasps</h2>", *map(_figure, drawn)]
    return "\n".join([*lines, "</body></html>", ""])


def _row(outcome: Outcome) -> str:
    epsilon = "" if outcome.best_epsilon is None else f"{outcome.best_epsilon:.4f}"
    cells = (
        ("text", outcome.mesh_id),
        ("", str(outcome.n_grasps)),
        ("", epsilon),
        ("", f"{outcome.n_held} of {outcome.n_tried}"),
        ("", f"{outcome.elapsed_s:.1f}"),
        ("text", "kept" if outcome.from_store else "new" if outcome.planned else ""),
        ("text", outcome.code),
    )
    inside = "".join(
        f'<td class="{kind}">{escape(text)}</td>' if kind else f"<td>{escape(text)}</td>"
        for kind, text in cells
    )
    start = "<tr>" if outcome.found else '<tr class="none">'
    return f"{start}{inside}</tr>"


def _figure(outcome: Outcome) -> str:
    name = escape(outcome.mesh_id)
    what = "best grasp" if outcome.found else "nearest miss, no force closure"
    return (
        f'<figure><img src="pictures/{quote(outcome.picture)}" alt="{name}" loading="lazy">'
        f"<figcaption>{name}: {what}</figcaption></figure>"
    )
