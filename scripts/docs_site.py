"""Gather the pages of the site in a folder: `make docs` builds it with mkdocs.

The pages stay where they are read on a forge, and links between them hold in both places: the
folder has the repository's layout. The interface reference is made here from its sources.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGES = (
    "README.md", "CONTRIBUTING.md", "CHANGELOG.md", "SECURITY.md", "CITATION.cff",
    "docs", "examples", "docker",
)  # fmt: skip
MESSAGES = "ros2_ws/src/gpis_grasp_msgs"
PYTHON = {
    "Plan": ("plan.planner.GraspPlanner", "plan.request.PlanRequest", "plan.request.PlanResult"),
    "Parts": ("geometry.catalogue.MeshCatalogue", "geometry.catalogue.load_part",
              "geometry.part.Part"),
    "Place": ("surroundings.place.Place",),
    "Grasps": ("grasp.grasp.Grasp", "quality.figures.Quality", "quality.figures.Figure"),
    "Hand": ("hand.description.HandDescription", "hand.description.load_hand"),
    "Store": ("store.record.Record", "store.conditions.Conditions"),
    "Errors": ("errors",),
}  # fmt: skip


def tracked(*paths: str) -> list[str]:
    """Files of the repository under some paths; what git ignores is no page."""
    command = ["git", "-C", str(ROOT), "ls-files", "--cached", "--others", "--exclude-standard"]
    listing = subprocess.run([*command, *paths], check=True, capture_output=True, text=True)
    return sorted(listing.stdout.split("\n")[:-1])


def interfaces() -> str:
    """The page of services, action and messages: their own texts, which carry the comments."""
    parts = [
        "# Services, action and messages",
        "From the sources of `gpis_grasp_msgs`. How they are used: [the node](../docs/node.md).",
    ]
    for kind, title in (("srv", "Services"), ("action", "Action"), ("msg", "Messages")):
        parts.append(f"## {title}")
        for path in tracked(f"{MESSAGES}/{kind}"):
            text = (ROOT / path).read_text(encoding="utf-8").rstrip()
            parts.append(f"### {Path(path).stem} ({kind})\n\n```text\n{text}\n```")
    return "\n\n".join(parts) + "\n"


def python() -> str:
    """The page of the Python interface: mkdocstrings fills it from the docstrings."""
    parts = ["# Python", "What a program of your own calls. From the docstrings."]
    for title, names in PYTHON.items():
        parts.append(f"## {title}")
        parts += [f"::: gpis_grasp_planner.{name}" for name in names]
    return "\n\n".join(parts) + "\n"


def gather(folder: Path) -> None:
    """Make the folder of sources anew."""
    shutil.rmtree(folder, ignore_errors=True)
    for name in tracked(*PAGES):
        target = folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, target)
    reference = folder / "reference"
    reference.mkdir()
    (reference / "interfaces.md").write_text(interfaces(), encoding="utf-8")
    (reference / "python.md").write_text(python(), encoding="utf-8")


def main() -> None:
    """Gather into the folder that is named."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=ROOT / "out/docs/sources")
    gather(parser.parse_args().folder)


if __name__ == "__main__":
    main()
