"""Check job: the conformance suite on a planner in a process of its own, which it may end."""

from __future__ import annotations

import contextlib
import sys
from dataclasses import dataclass
from functools import partial

import msgspec

from interplan_sumo.batch.engine import run_tasks
from interplan_sumo.batch.tasks import Answer, Limits, Publish, Task, Work
from interplan_sumo.planner import Planner, load_planner
from interplan_sumo.testing import ConformanceFinding, check_planner


@dataclass(frozen=True, slots=True)
class CheckedPlanner:
    """What the conformance suite found, and the end of what the planner printed meanwhile."""

    findings: tuple[ConformanceFinding, ...]
    printed: str


def checked_planner(name: str) -> CheckedPlanner:
    """The conformance suite on a planner, named as `run --planner` takes it; InputError if it cannot be built.

    A planner that ends or crashes its process has a finding that says so, and no other.
    """
    (outcome,) = run_tasks([Task(name, name, name)], _open, workers=1, limits=Limits())
    if outcome.fault is not None:
        text = f"{outcome.fault.message}; a planner returns a plan or raises an error"
        return CheckedPlanner((ConformanceFinding("error", "process", text),), outcome.printed)
    return CheckedPlanner(msgspec.convert(outcome.value["findings"], tuple[ConformanceFinding, ...]), outcome.printed)


def _open(name: str, publish: Publish) -> Work:
    return partial(_check, load_planner(name), publish)


def _check(planner: Planner, publish: Publish, _name: str) -> Answer:
    with contextlib.redirect_stdout(sys.stderr):  # which keeps no line back from a planner that ends the process
        findings = check_planner(planner, on_call=publish)
    return {"findings": msgspec.to_builtins(findings)}, None
