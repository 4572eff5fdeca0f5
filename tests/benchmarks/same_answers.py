"""The same hands closed by this version and a former one: are the answers the same, and how fast.

    python tests/benchmarks/same_answers.py
    python tests/benchmarks/same_answers.py --former 61fc508 --attempts 800

The hands are those that the default planner closes on the 13 shipped parts: some ten thousand.
Status, contacts, joints, positions, normals, epsilon and volume are compared number by number.
The former version is the work tree of `bench.py`. Both go over each part in turn, a few times, in
processes that live beside each other; of the passes the least processor time counts.
"""

from __future__ import annotations

import argparse
import io
import os
import sys
import time
from pathlib import Path

import numpy as np
from recorded_attempts import recording
from two_versions import FORMER, OUT, ROOT, Server, former_tree

COMPARED = (
    "status", "n_contacts", "joints", "positions", "normals_inward", "friction", "links",
    "epsilon", "volume",
)  # fmt: skip
_PASSES = 3


def recorded_hands(part_id: str, attempts: int) -> dict[str, np.ndarray]:
    """Palms and postures that the default planner closes on a part, and the friction."""
    from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
    from gpis_grasp_planner.plan.planner import GraspPlanner
    from gpis_grasp_planner.plan.request import PlanRequest
    from gpis_grasp_planner.scene.compiled_evaluator import CompiledEvaluator

    part = MeshCatalogue([default_catalogue_directory()]).load(part_id)
    request = PlanRequest(
        time_budget_s=600.0, verification="none", max_evaluations=attempts, n_grasps=5
    )
    with recording(CompiledEvaluator) as recorded:
        GraspPlanner().answer(part, request)
    friction = recorded[0][0].friction
    return {
        "T": np.concatenate([T for _, T, _ in recorded]),
        "start": np.concatenate([start for _, _, start in recorded]),
        "friction": np.array([friction.finger, friction.palm]),
    }


def serve() -> None:
    """Close the hands of every file named on standard input; answers go to the file beside it."""
    from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
    from gpis_grasp_planner.geometry.part import Friction
    from gpis_grasp_planner.grasp.scene_settings import SceneSettings
    from gpis_grasp_planner.hand.description import load_hand
    from gpis_grasp_planner.scene.compiled_evaluator import CompiledEvaluator

    catalogue = MeshCatalogue([default_catalogue_directory()])
    evaluator, part_id = None, None
    for line in sys.stdin:
        path = Path(line.strip())
        hands = np.load(path)
        if path.stem != part_id:
            part_id = path.stem
            friction = Friction(*hands["friction"].tolist())
            part = catalogue.load(part_id)
            evaluator = CompiledEvaluator(load_hand(), part, friction, SceneSettings())
            evaluator.attempt_from(hands["T"][:1], hands["start"][:1])
        begin = time.thread_time()
        found = evaluator.attempt_from(hands["T"], hands["start"])
        spent = time.thread_time() - begin
        content = io.BytesIO()
        np.savez(content, spent=spent, **{name: getattr(found, name) for name in COMPARED})
        written = path.with_suffix(f".{os.getpid()}")
        written.write_bytes(content.getvalue())
        print(written, flush=True)


def answers(server: Server, path: Path) -> dict[str, np.ndarray]:
    """What a version answers for the hands of a file."""
    written = Path(server.asked(str(path)))
    found = dict(np.load(io.BytesIO(written.read_bytes())))
    written.unlink()
    return found


def main() -> None:
    """Close the hands with both versions and say how the answers differ."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--former", default=FORMER, help="revision to compare with")
    parser.add_argument("--attempts", type=int, default=800, help="of each part")
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.serve:
        serve()
        return
    os.environ["GPIS_GRASP_STORE"] = "off"
    from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory

    folder = OUT / "hands"
    folder.mkdir(parents=True, exist_ok=True)
    trees = (ROOT, former_tree(arguments.former))
    now, former = (Server(tree, __file__) for tree in trees)
    total, differ, spent = 0, 0, np.zeros(2)
    for part_id in MeshCatalogue([default_catalogue_directory()]).ids():
        path = folder / f"{part_id}.npz"
        np.savez(path, **recorded_hands(part_id, arguments.attempts))
        passes = [(answers(now, path), answers(former, path)) for _ in range(_PASSES)]
        ours, theirs = passes[0]
        wrong = np.zeros(len(ours["status"]), dtype=bool)
        for name in COMPARED:
            apart = (ours[name] != theirs[name]).reshape(len(wrong), -1).any(axis=1)
            if apart.any():
                most = np.abs(ours[name][apart] - theirs[name][apart]).max()
                print(f"{part_id}: {name} of {apart.sum()} hands differs, by {most:.3g} at most")
            wrong |= apart
        times = np.array([[float(one["spent"]) for one in both] for both in passes]).min(axis=0)
        rates = len(wrong) / times
        print(
            f"{part_id}: {len(wrong)} hands, {wrong.sum()} differ; {rates[0]:.0f} a second now, "
            f"{rates[1]:.0f} before",
            flush=True,
        )
        total, differ, spent = total + len(wrong), differ + int(wrong.sum()), spent + times
    print(
        f"All: {total} hands, {differ} differ; {total / spent[0]:.0f} a second and core now, "
        f"{total / spent[1]:.0f} before, {spent[1] / spent[0]:.2f} times as fast."
    )
    now.close()
    former.close()


if __name__ == "__main__":
    main()
