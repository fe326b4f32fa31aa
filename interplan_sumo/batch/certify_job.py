"""Certify job: what a worker does to prove one scenario solvable, or to check the proof that is stored."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass
from typing import Any

from interplan_sumo.batch.engine import run_tasks
from interplan_sumo.batch.shared_phase import Publish
from interplan_sumo.batch.tasks import Answer, Fault, Limits, Task, Work
from interplan_sumo.scenario.certificates import Certificate
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.verification.certificates import certify, check_certificate

GROUP = "certify"


@dataclass(frozen=True, slots=True, eq=False)
class Proof:
    """How one scenario fared."""

    scenario: Scenario
    certificate: Certificate | None
    """What was found, or was checked and holds."""
    problems: tuple[str, ...]
    """Why there is none; empty if there is one."""
    simulations: int
    wall_s: float


def proofs(
    scenarios: Sequence[Scenario],
    *,
    workers: int,
    stored: dict[str, Certificate] | None = None,
    limits: Limits | None = None,
) -> Generator[Proof]:
    """Certify scenarios, or with `stored` certificates check those, in worker processes; 0 works in this one.

    Yields one proof per scenario in the order in which they end; each depends
    on its scenario alone. Closing the iterator ends all workers.
    """
    tasks = [
        Task(s.id, GROUP, (s, None if stored is None else _as_json(stored.get(s.id)), stored is not None))
        for s in scenarios
    ]
    for outcome in run_tasks(tasks, _open, workers=workers, limits=limits or Limits()):
        scenario: Scenario = outcome.task.payload[0]
        value, fault = outcome.value, outcome.fault
        found = value.get("certificate")
        problems = [f"{fault.kind}: {fault.message}"] if fault is not None else value["problems"]
        yield Proof(
            scenario,
            Certificate.from_json(found) if found and not problems else None,
            tuple(problems),
            value.get("simulations", 0),
            outcome.wall_s,
        )


def _as_json(certificate: Certificate | None) -> dict[str, Any] | None:
    return None if certificate is None else certificate.as_json()


def _open(_group: str, publish: Publish) -> Work:
    def work(payload: tuple[Scenario, dict[str, Any] | None, bool]) -> Answer:
        publish("simulate")
        scenario, stored, only_check = payload
        return (_checked(scenario, stored) if only_check else _found(scenario)), _NO_FAULT

    return work


_NO_FAULT: Fault | None = None


def _found(scenario: Scenario) -> dict[str, Any]:
    verdict = certify(scenario)
    return {
        "certificate": _as_json(verdict.certificate),
        "problems": [] if verdict.reason is None else [verdict.reason],
        "simulations": verdict.simulations,
    }


def _checked(scenario: Scenario, stored: dict[str, Any] | None) -> dict[str, Any]:
    problems = (
        ["no certificate is stored"] if stored is None else check_certificate(scenario, Certificate.from_json(stored))
    )
    return {"certificate": stored, "problems": problems, "simulations": 2 if stored is not None else 0}
