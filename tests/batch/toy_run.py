"""A run of toy tasks into a run folder, to be killed: python -m tests.batch.toy_run FOLDER COUNT WORKERS."""

from __future__ import annotations

import hashlib
import sys
import time
from contextlib import closing
from pathlib import Path
from typing import Any

from interplan_sumo.batch.engine import run_tasks
from interplan_sumo.batch.phases import Publish
from interplan_sumo.batch.run_folder import RunFolder
from interplan_sumo.batch.tasks import Answer, Limits, Task, Work


def open_hasher(_group: str, publish: Publish) -> Work:
    """Tasks that take a while in each phase and give the same hash every time."""

    def work(number: int) -> Answer:
        digest = hashlib.sha256()
        for step in range(10):
            publish("plan")
            digest.update(f"{number} {step}".encode())
            time.sleep(0.001)
            publish("simulate")
            time.sleep(0.001)
        return {"trace_hash": digest.hexdigest()}, None

    return work


def toy_row(scenario: str, value: dict[str, Any]) -> dict[str, Any]:
    return {"scenario_id": scenario, "family": "toy", "planner": "toy", "seed": 0, "score": 1.0, "metrics": {},
            "fault": None, **value}  # fmt: skip


def main(folder: Path, count: int, workers: int) -> None:
    request = {"planners": ["toy"], "scenarios": [f"toy/{n}" for n in range(count)], "seeds": 1}
    with RunFolder(folder, {"suite": "toy==1"}, request, {}) as held:
        tasks = [Task(n, "toy", n) for n in range(count) if (f"toy/{n}", "toy", 0) not in held.done]
        with closing(run_tasks(tasks, open_hasher, workers=workers, limits=Limits())) as outcomes:
            for outcome in outcomes:
                assert outcome.fault is None, outcome.fault
                held.append(toy_row(f"toy/{outcome.task.payload}", outcome.value))


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))
