"""Certify job: what a worker does to prove one scenario solvable, or to check the proof that is stored."""

from __future__ import annotations

from collections.abc import Generator, Sequence

import msgspec

from interplan_sumo.batch.engine import run_tasks
from interplan_sumo.batch.processes import available_cores
from interplan_sumo.batch.tasks import Answer, Limits, Publish, Task, Work
from interplan_sumo.scenario.certificates import Certificate, CertificateRecord
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.verification.certificates import Proof, certify, check_certificate

GROUP = "certify"


class ProofAnswer(msgspec.Struct, frozen=True):
    """What a worker says of one scenario; nothing after a fault."""

    certificate: CertificateRecord | None = None
    problems: tuple[str, ...] = ()
    simulations: int = 0


def proofs(
    scenarios: Sequence[Scenario],
    *,
    workers: int | None,
    stored: dict[str, Certificate] | None = None,
    panel: Sequence[str] | None = None,
) -> Generator[Proof]:
    """Certify scenarios, or with `stored` certificates check those, in worker processes.

    A `panel` of planners drives each scenario that is certified. 0 workers work
    in this process, None takes all cores. Yields one proof per scenario in the
    order in which they end; each depends on its scenario alone. Closing the
    iterator ends all workers.
    """
    tasks = [Task(s.id, GROUP, (s, (stored or {}).get(s.id), stored is not None, panel)) for s in scenarios]
    many = available_cores() if workers is None else workers
    for outcome in run_tasks(tasks, _open, workers=many, limits=Limits()):
        fault, answer = outcome.fault, msgspec.convert(outcome.value, ProofAnswer)
        problems = answer.problems if fault is None else (f"{fault.kind}: {fault.message}",)
        found = None if answer.certificate is None or problems else Certificate.of(answer.certificate)
        yield Proof(outcome.task.payload[0], found, problems, answer.simulations, outcome.wall_s)


def _open(_group: str, publish: Publish) -> Work:
    def work(payload: tuple[Scenario, Certificate | None, bool, Sequence[str] | None]) -> Answer:
        publish("simulate")
        scenario, held, only_check, panel = payload
        if only_check:
            proof = Proof(scenario, held, tuple(check_certificate(scenario, held)), 0 if held is None else 2)
        else:
            proof = certify(scenario, panel=panel)
        record = None if proof.certificate is None else proof.certificate.record()
        return msgspec.to_builtins(ProofAnswer(record, proof.problems, proof.simulations)), None

    return work
