"""One object of a success study: plan, then try the answer in physics, whatever the planner tried.

Planning may verify its finalists itself. The study tries them again, with displacements that the
planner has not seen, so that its shares do not rest on what the ranking was chosen by.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

from gpis_grasp_benchmark.runs import EDGES, Record, Run, environment, hash_of, source_hash
from gpis_grasp_benchmark.strict_tests import NOMINAL, StrictTests, volume_mass
from gpis_grasp_planner.errors import GraspPlannerError
from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.plan.document import document_text
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.request import PlanResult
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.plan.warm_up import warm_up
from gpis_grasp_planner.verification.protocol import prepare

SECOND_PLANNER = "eigengrasp-two-level"
# Beside two plans: the convex cover and some 30 trials of at most 10 s.
_TRIALS_S = 600.0


@dataclass(frozen=True)
class ObjectRun:
    """A plan of one object, and what is done with its grasps: the subclasses say what.

    Attributes
    ----------
    plan : Run
        The planning; its number of grasps is that of the answer.
    object_set : str
    """

    plan: Run
    object_set: str

    @property
    def object_id(self) -> str:
        """Of the planning."""
        return self.plan.object_id

    @property
    def name(self) -> str:
        """Of the planning."""
        return self.plan.name

    def identity(self) -> Record:
        """What a finished run is recognised by."""
        return {**self.plan.identity(), "object_set": self.object_set}

    @property
    def key(self) -> str:
        """Hash of the identity."""
        return hash_of(self.identity())


@dataclass(frozen=True)
class StudyRun(ObjectRun):
    """Everything that decides what comes of one object, but for the clock.

    Attributes
    ----------
    tried : int
        Grasps of the answer that get the nominal trial; the first one gets all tests.
    second_planner : str
        Asked where none of those holds, to tell whether the object is graspable at all.
    displacements : int
        Under pose noise.
    noise_seed : int
        Of the displacements; not the planner's seed.
    """

    tried: int = 5
    second_planner: str = SECOND_PLANNER
    displacements: int = 10
    noise_seed: int = 20_000

    @property
    def longest_s(self) -> float:
        """Two plans and all trials."""
        return 2.0 * self.plan.longest_s + _TRIALS_S

    def identity(self) -> Record:
        """What a finished run is recognised by."""
        return {
            "protocol": "strict",
            **super().identity(),
            "tried": self.tried,
            "second_planner": self.second_planner,
            "displacements": self.displacements,
            "noise_seed": self.noise_seed,
        }

    def make(self, part: Part) -> tuple[Record, str]:
        """Plan and try in this process: the record, and the first planner's document."""
        here = study_environment()
        warm_up([self.plan.planner, self.second_planner])
        planner = GraspPlanner(PlannerSettings.from_mapping(self.plan.settings))
        settings = replace(planner.settings.verification, noise_repeats=self.displacements)
        trials: list[Record] = []
        document, cover_s = "", 0.0
        plans: list[Record] = []
        for name in dict.fromkeys((self.plan.planner, self.second_planner)):
            result, plan = self._plan(planner, part, name)
            plans.append(plan)
            if result is not None and result.grasps:
                start = time.perf_counter()
                prepare(part, settings)
                cover_s = max(cover_s, time.perf_counter() - start)
                tests = StrictTests(part, planner.hand, settings, name)
                trials += tests.nominal(result.grasps[: self.tried])
                if name == self.plan.planner:
                    trials += tests.further(result.grasps[0], self.noise_seed)
            if result is not None and name == self.plan.planner:
                document = document_text(result)
            if any(row["held"] for row in trials if row["test"] == NOMINAL):
                break
        return {
            "key": self.key,
            **self.identity(),
            "settings": {group: dict(values) for group, values in self.plan.settings.items()},
            "extent_m": [float(side) for side in part.mesh.extent],
            "faces": len(part.mesh.faces),
            "watertight": part.watertight,
            "volume_m3": float(part.volume),
            "cad_mass_kg": volume_mass(part, settings),
            "notes": list(part.notes),
            "plans": plans,
            "cover_s": cover_s,
            "trials": trials,
            "environment": here,
        }, document

    def _plan(
        self, planner: GraspPlanner, part: Part, name: str
    ) -> tuple[PlanResult | None, Record]:
        request = replace(self.plan.request(), planner=name, verification="rank")
        cpu = time.process_time()
        try:
            result = planner.plan(part, request)
        except GraspPlannerError as error:
            # The object is one that cannot be planned on: a finding, not a fault of the study.
            return None, {
                "planner": name, "status": error.code.name, "message": str(error),
                "elapsed_s": 0.0, "cpu_s": 0.0, "evaluations": 0, "epsilon": [], "said_to_hold": [],
            }  # fmt: skip
        return result, {
            "planner": name,
            "status": result.code.name,
            "message": result.message,
            "elapsed_s": float(result.elapsed_s),
            "cpu_s": time.process_time() - cpu,
            "evaluations": int(result.evaluations),
            "epsilon": [float(grasp.epsilon) for grasp in result.grasps],
            # None where the planner did not try it.
            "said_to_hold": [g.trials.held if g.trials else None for g in result.grasps],
        }


def study_environment() -> Record:
    """Versions and machine; `source` covers the verification, too, which decides the verdicts."""
    return {**environment(), "source": source_hash(EDGES - {"verification"})}
