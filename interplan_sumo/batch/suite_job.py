"""Suite job: workers judge the candidates of a suite; what was found is kept, so that a stopped search goes on."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

import msgspec

from interplan_sumo.batch.engine import run_tasks
from interplan_sumo.batch.processes import available_cores
from interplan_sumo.batch.tasks import Answer, Limits, Publish, Task, Work
from interplan_sumo.metrics.score import SCORING_VERSION
from interplan_sumo.simulation.traffic import TRAFFIC_VERSION
from interplan_sumo.verification.suite_candidates import Candidate
from interplan_sumo.verification.suite_judging import Verdict, judged
from interplan_sumo.world.files import writing

GROUP: Final = "suite"


def verdicts(
    candidates: Sequence[Candidate], folder: Path, *, workers: int | None
) -> Iterator[tuple[Candidate, Verdict]]:  # fmt: skip
    """What is found of each candidate, in the order in which they end; what `folder` knows is not looked for again.

    0 workers work in this process, None takes all cores.
    """
    folder.mkdir(parents=True, exist_ok=True)
    unknown: list[Candidate] = []
    for candidate in candidates:
        path = _path(folder, candidate)
        if path.is_file():
            yield candidate, msgspec.json.decode(path.read_bytes(), type=Verdict)
        else:
            unknown.append(candidate)
    tasks = [Task(candidate.key, GROUP, candidate) for candidate in unknown]
    many = available_cores() if workers is None else workers
    for outcome in run_tasks(tasks, _open, workers=many, limits=Limits()):
        candidate: Candidate = outcome.task.payload
        if outcome.fault is not None:
            found = Verdict("fault", f"{outcome.fault.kind}: {outcome.fault.message}", candidate.scenarios[0].id)
        else:
            found = msgspec.convert(outcome.value, Verdict)
        path = _path(folder, candidate)
        with writing(path, "give another folder as --out"):
            fresh = path.with_suffix(".part")
            fresh.write_bytes(msgspec.json.encode(found))
            fresh.replace(path)
        yield candidate, found


def _path(folder: Path, candidate: Candidate) -> Path:
    """Where the verdict on a candidate is kept: by all that it depends on but the code of the search."""
    text = f"{candidate.key} {SCORING_VERSION} {TRAFFIC_VERSION} {candidate.slot.may_be_open}"
    return folder / f"{candidate.slot.name}-{hashlib.sha256(text.encode()).hexdigest()[:16]}.json"


def _open(_group: str, publish: Publish) -> Work:
    def work(candidate: Candidate) -> Answer:
        publish("simulate")
        return msgspec.to_builtins(judged(candidate)), None

    return work
