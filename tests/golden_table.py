"""Golden table: every stored case of nuPlan's metrics, controller and IDM, and how far ours is from it.

    python -m tests.golden_table

Reads tests/golden, or the folder of the same format that INTERPLAN_GOLDEN
names; it may hold only some of the three. Exit code 1 if any case fails, 2 if
there is none.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from tests.dynamics import golden_controller
from tests.golden_values import GOLDEN, TOLERANCE, Pair
from tests.metrics import golden_metrics
from tests.planners import golden_idm


@dataclass(frozen=True)
class Line:
    """One case of the table."""

    case: str
    values: int
    difference: float
    wrong: str
    """What is farthest off, or why nothing could be compared; empty if the case agrees."""

    @classmethod
    def of(cls, case: str, compare: Callable[[], Iterable[Pair]]) -> Line:
        """The line of a case that `compare` reads; whatever goes wrong there fails this case only."""
        try:
            found = list(compare())
        except Exception as error:
            return cls(case, 0, float("inf"), f"{type(error).__name__}: {' '.join(str(error).split())}")
        if not found:
            return cls(case, 0, float("inf"), "holds nothing to compare")
        worst = max(found, key=lambda pair: pair.difference)
        wrong = "" if worst.difference <= TOLERANCE else worst.what
        return cls(case, sum(pair.count for pair in found), worst.difference, wrong)


def lines() -> Iterator[Line]:
    """All cases, metrics first."""
    for folder in golden_metrics.case_folders():
        case = f"nuplan_metrics/{folder.name}"
        yield Line.of(case, lambda folder=folder: golden_metrics.pairs(golden_metrics.read_case(folder)))
    for name in golden_controller.case_names():
        case = f"nuplan_controller/{name}"
        yield Line.of(case, lambda name=name: golden_controller.pairs(golden_controller.read_case(name)))
    for case in golden_idm.read_cases():
        yield Line.of(f"nuplan_idm/{case['name']}", lambda case=case: golden_idm.pairs(case))


def main() -> int:
    """Print the table; the exit code."""
    print(f"{'case':<56}{'values':>8}  largest difference", flush=True)
    done: list[Line] = []
    for line in lines():
        done.append(line)
        verdict = f"  FAILED: {line.wrong}" if line.wrong else ""
        print(f"{line.case:<56}{line.values:>8}  {line.difference:.1e}{verdict}", flush=True)
    if not done:
        print(f"error: no golden case in {GOLDEN}; INTERPLAN_GOLDEN names another folder", file=sys.stderr)
        return 2
    failed = sum(bool(line.wrong) for line in done)
    values = sum(line.values for line in done)
    largest = max(line.difference for line in done)
    print(f"{len(done)} cases, {values} values, largest difference {largest:.1e}, {failed} failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
