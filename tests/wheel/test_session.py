"""A person's drives on SUMO: rows as those of any planner, that come again from their plans, and can be taken over."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from interplan_sumo.batch.options import RunOptions
from interplan_sumo.batch.run_folder import read_run
from interplan_sumo.batch.verify import RowSample, verify
from interplan_sumo.errors import InputError, UnknownNameError
from interplan_sumo.scenario.files import write_scenarios
from interplan_sumo.wheel.server import WheelServer
from interplan_sumo.wheel.session import Seating, Session, StoredStart
from tests.scenes import scene
from tests.wheel.visitors import asked, events, hold

pytestmark = pytest.mark.slow


class Robot(threading.Thread):
    """Sits at the page: starts, holds what it is told, and says at the end of each drive what it wishes next."""

    def __init__(self, wishes: Sequence[str], *, restart_at: int | None = None, **hands: float) -> None:
        super().__init__(daemon=True)
        self._wishes = iter(wishes)
        self._restart_at = restart_at
        self._hands = hands
        self.heard: list[dict[str, Any]] = []
        self.watched: list[str] = []
        """Replays."""

    def sit_down(self, server: WheelServer) -> None:
        self.server = server
        self.start()

    def run(self) -> None:
        number = 0
        with events(self.server) as stream:
            for event in stream:
                self.heard.append(event)
                act = "start" if event["kind"] == "ready" else None
                if event["kind"] == "end":
                    self.watched.append(asked(self.server, f"/{self.server.token}/replay/{event['replay']}").text)
                    act = next(self._wishes)
                if event["kind"] == "frame" and event["frame"] == self._restart_at:
                    act, self._restart_at = "restart", None
                if event["kind"] == "over":
                    return
                if act is not None:
                    number += 1
                    hold(self.server, number=number, act=act, **self._hands)

    def ends(self) -> list[dict[str, Any]]:
        return [event for event in self.heard if event["kind"] == "end"]


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Robot]:
    """A scene of 1.5 s, begun anew at 0.5 s and then driven to its end, twice: a second time into a folder beside."""
    place = tmp_path_factory.mktemp("wheel")
    write_scenarios([replace(scene("nudge/0"), duration_s=1.5)], place / "mine.yaml")
    options = RunOptions(scenarios=(str(place / "mine.yaml"),))
    robot = Robot(["again", "next"], restart_at=5, push=0.8)
    seating = replace(Seating.of(options, place / "run"), rate=50.0)
    assert Session(seating).drive(robot.sit_down)
    robot.join(5.0)
    return place / "run", robot


def test_a_drive_is_a_row_of_planner_human_that_comes_again_from_its_plans(driven: tuple[Path, Robot]) -> None:
    run = read_run(driven[0])
    ((key, row),) = run.rows.items()
    assert key == ("nudge/0", "human", 0)
    assert row.fault is None
    assert row.score is not None
    (check,) = verify(run, RowSample(None), RunOptions(workers=0)).checks
    assert check.verdict == "equal"
    assert read_run(driven[0].with_name("run-2")).rows[key].score is not None


def test_the_person_is_told_how_each_drive_went_and_what_was_begun_anew_leaves_nothing(
    driven: tuple[Path, Robot],
) -> None:
    folder, robot = driven
    began = [event for event in robot.heard if event["kind"] == "frame" and event["frame"] == 0]
    assert len(began) == 3
    first, second = robot.ends()
    assert first["score"] == round(100.0 * (read_run(folder).rows["nudge/0", "human", 0].score or 0.0), 1)
    assert (first["replay"], second["replay"]) == (0, 1)
    assert all("<title>nudge/0 with human</title>" in page for page in robot.watched)


def test_a_stored_drive_is_taken_over_at_any_moment_by_who_brakes_there(
    driven: tuple[Path, Robot], tmp_path: Path
) -> None:
    before = read_run(driven[0]).rows["nudge/0", "human", 0]
    seating = Seating.of(RunOptions(scenarios=("nudge/0",)), tmp_path / "run", start=StoredStart(driven[0], at_s=0.7))
    robot = Robot(["quit"], push=-1.0)
    assert not Session(replace(seating, rate=50.0)).drive(robot.sit_down)
    robot.join(5.0)
    run = read_run(tmp_path / "run")
    (row,) = run.rows.values()
    assert row.planner == "human after human at 0.7 s"
    assert row.trace_hash != before.trace_hash
    speeds = [event["speed_mps"] for event in robot.heard if event["kind"] == "frame"]
    assert speeds[7] > speeds[0]
    assert speeds[-1] < speeds[7]
    assert verify(run, RowSample(None), RunOptions(workers=0)).count("equal") == 1


@pytest.mark.parametrize(
    ("options", "start", "message"),
    [
        ({"scenarios": ()}, {}, "name what to drive"),
        ({"scenarios": ("nudge/0",), "density": "high"}, {}, "leave out density"),
        ({"scenarios": ("nudge/0", "nudge/1")}, {}, "name one scenario"),
        ({"scenarios": ("nudge/77",)}, {}, "nudge/77"),
        ({"scenarios": ("nudge/0",)}, {"at_s": 1.5}, "which lasts 1.4 s"),
        ({"scenarios": ("nudge/0",)}, {"at_s": -0.1}, "lies outside"),
        ({"scenarios": ("nudge/0",)}, {"planner": "idm"}, "idm"),
    ],
)
def test_what_cannot_be_taken_over_is_said(
    driven: tuple[Path, Robot], options: dict[str, Any], start: dict[str, Any], message: str
) -> None:
    with pytest.raises((InputError, UnknownNameError), match=message):
        Seating.of(RunOptions(**options), Path("new"), start=StoredStart(driven[0], **start))


def test_what_is_driven_already_is_not_driven_over(driven: tuple[Path, Robot]) -> None:
    options = RunOptions(scenarios=(str(driven[0].parent / "mine.yaml"),))
    with pytest.raises(InputError, match="holds these drives already"):
        Seating.of(options, driven[0])
    with pytest.raises(InputError, match="--speed 3"):
        Seating.of(options, Path("new"), 3.0)
