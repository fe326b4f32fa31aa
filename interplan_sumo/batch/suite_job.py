"""Suite job: workers judge the candidates of a suite; what was found is kept, so that a stopped search goes on."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

import msgspec

from interplan_sumo.batch.kept_answers import kept_answers
from interplan_sumo.batch.processes import Workers, available_cores
from interplan_sumo.batch.records import Fault
from interplan_sumo.batch.tasks import Answer, Publish, Task, Work
from interplan_sumo.metrics.score import SCORING_VERSION
from interplan_sumo.simulation.traffic import TRAFFIC_VERSION
from interplan_sumo.verification.suite_candidates import Candidate
from interplan_sumo.verification.suite_judging import Verdict, judged

GROUP: Final = "suite"


def verdicts(
    candidates: Sequence[Candidate], folder: Path, *, workers: int | None
) -> Iterator[tuple[Candidate, Verdict]]:  # fmt: skip
    """What is found of each candidate, in the order in which they end; what `folder` knows is not looked for again.

    0 workers work in this process, None takes all cores.
    """
    tasks = [Task(candidate.key, GROUP, candidate) for candidate in candidates]
    who = Workers(available_cores() if workers is None else workers)
    return kept_answers(tasks, lambda task: _path(folder, task.payload), _fault, Verdict, _open, who)


def _fault(task: Task, fault: Fault) -> Verdict:
    candidate: Candidate = task.payload
    return Verdict("fault", f"{fault.kind}: {fault.message}", candidate.scenarios[0].id)


def _path(folder: Path, candidate: Candidate) -> Path:
    """Where the verdict on a candidate is kept: by all that it depends on but the code of the search."""
    text = f"{candidate.key} {SCORING_VERSION} {TRAFFIC_VERSION} {candidate.slot.may_be_open}"
    return folder / f"{candidate.slot.name}-{hashlib.sha256(text.encode()).hexdigest()[:16]}.json"


def _open(_group: str, publish: Publish) -> Work:
    def work(candidate: Candidate) -> Answer:
        publish("simulate")
        return msgspec.to_builtins(judged(candidate)), None

    return work
