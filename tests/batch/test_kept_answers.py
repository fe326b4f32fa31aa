"""Kept answers: what has been found is not looked for again, and what says nothing of a task is not kept."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from interplan_sumo.batch.kept_answers import kept_answers
from interplan_sumo.batch.processes import Workers
from interplan_sumo.batch.records import Fault, FaultClass
from interplan_sumo.batch.tasks import Answer, OpenGroup, Publish, Task, Work


class Square(msgspec.Struct, frozen=True):
    """What is found of a number, or a fault in words."""

    square: int
    fault: str = ""


def squares(folder: Path, jobs: OpenGroup, *numbers: int) -> dict[int, Square]:
    tasks = [Task(("n", n), "squares", n) for n in numbers]
    return dict(
        kept_answers(
            tasks,
            lambda task: folder / f"{task.payload}.json",
            lambda _task, fault: Square(-1, fault.kind),
            Square,
            jobs,
            Workers(0),
        )
    )


class Squares:
    """Finds squares, but for one number, and counts."""

    def __init__(self, fault: FaultClass = "harness", of: int = -1) -> None:
        self.asked: list[int] = []
        self._fault, self._of = Fault(fault, "no memory left"), of

    def __call__(self, _group: str, publish: Publish) -> Work:
        def work(number: int) -> Answer:
            publish("simulate")
            self.asked.append(number)
            return {"square": number * number}, self._fault if number == self._of else None

        return work


def test_what_is_known_is_not_looked_for_again(tmp_path: Path) -> None:
    first, second = Squares(), Squares()
    assert squares(tmp_path / "kept", first, 2, 3) == {2: Square(4), 3: Square(9)}
    assert squares(tmp_path / "kept", second, 2, 3, 4) == {2: Square(4), 3: Square(9), 4: Square(16)}
    assert (first.asked, second.asked) == ([2, 3], [4])


@pytest.mark.parametrize(("fault", "again"), [("timeout", [3]), ("harness", [3]), ("traffic", []), ("planner", [])])
def test_a_fault_of_the_machine_is_tried_again_and_others_are_an_answer(
    fault: FaultClass, again: list[int], tmp_path: Path
) -> None:
    assert squares(tmp_path, Squares(fault, of=3), 2, 3)[3] == Square(-1, fault)
    second = Squares()
    assert squares(tmp_path, second, 2, 3)[3] == (Square(9) if again else Square(-1, fault))
    assert second.asked == again


@pytest.mark.parametrize("torn", [b"", b'{"square": 4', b'{"square": "x"}'])
def test_a_file_that_a_power_cut_tore_is_found_anew(torn: bytes, tmp_path: Path) -> None:
    (tmp_path / "2.json").write_bytes(torn)
    assert squares(tmp_path, Squares(), 2) == {2: Square(4)}
    assert squares(tmp_path, Squares(of=2), 2) == {2: Square(4)}
