"""Hard job: workers, here or on a Ray cluster, judge scenes that are searched to be hard; what was found is kept."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Final

import msgspec

from interplan_sumo.batch.kept_answers import kept_answers
from interplan_sumo.batch.processes import Workers
from interplan_sumo.batch.records import Fault
from interplan_sumo.batch.remote_jobs import Files
from interplan_sumo.batch.tasks import Answer, OpenGroup, Publish, Task, Work
from interplan_sumo.metrics.score import SCORING_VERSION
from interplan_sumo.planner_source import PlannerSource
from interplan_sumo.scenario.files import MAPS
from interplan_sumo.simulation.traffic import TRAFFIC_VERSION
from interplan_sumo.verification.hard_judging import HardCandidate, HardVerdict, judged_hard

GROUP: Final = "hard"


def hard_verdicts(
    candidates: Sequence[HardCandidate], folder: Path, workers: Workers
) -> Iterator[tuple[HardCandidate, HardVerdict]]:
    """What is found of each candidate, in the order in which they end; what `folder` knows is not looked for again."""
    tasks = [Task(candidate.scenario.id, GROUP, candidate) for candidate in candidates]
    roots = {candidate.scenario.maps_beside for candidate in candidates} - {None}
    jobs = HardJobs(next(iter(roots), None))
    return kept_answers(tasks, lambda task: answer_path(folder, task.payload), _fault, HardVerdict, jobs, workers)


@dataclass(frozen=True, slots=True)
class HardJobs:
    """Judging on any machine: maps that are not shipped lie in `maps_beside`, and go where that is not seen."""

    maps_beside: Path | None

    def stage_in(self) -> Files:
        root = self.maps_beside
        if root is None:
            return {}
        return {
            f"{MAPS}/{path.relative_to(root).as_posix()}": path.read_bytes()
            for path in sorted(root.rglob("*"))
            if path.is_file()
        }

    def open_in(self, folder: Path) -> OpenGroup:
        there = folder / MAPS
        return _Opening(there if self.maps_beside is not None and there.is_dir() else self.maps_beside)

    def needs(self, task: Task) -> Files:  # noqa: ARG002 (as the protocol has it)
        return {}

    def collect(self, folder: Path) -> Files:  # noqa: ARG002
        return {}

    def stage_out(self, files: Files) -> None:  # noqa: ARG002
        return None


@dataclass(frozen=True, slots=True)
class _Opening:
    """Opens the group, in whichever process it is sent to."""

    maps_beside: Path | None

    def __call__(self, _group: str, publish: Publish) -> Work:
        def work(candidate: HardCandidate) -> Answer:
            publish("simulate")
            here = replace(candidate.scenario, maps_beside=self.maps_beside)
            return msgspec.to_builtins(judged_hard(replace(candidate, scenario=here))), None

        return work


def _fault(_task: Task, fault: Fault) -> HardVerdict:
    return HardVerdict("fault", f"{fault.kind}: {fault.message}")


def answer_path(folder: Path, candidate: HardCandidate) -> Path:
    """Where a verdict is kept: by all that it depends on but the code of the search."""
    panel = [f"{name} {_source_hash(name)}" for name in candidate.panel]
    asked = f"{panel} {candidate.most_solved} {sorted(candidate.must_fail)} {sorted(candidate.alone)}"
    text = f"{candidate.scenario.hash()} {asked} {SCORING_VERSION} {TRAFFIC_VERSION}"
    return folder / f"{hashlib.sha256(text.encode()).hexdigest()[:24]}.json"


@cache
def _source_hash(planner: str) -> str:
    return PlannerSource.of(planner).hash
