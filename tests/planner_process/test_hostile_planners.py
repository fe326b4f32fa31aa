"""Whatever a planner does to its process is one planner fault or nothing, and no other drive knows of it."""

from __future__ import annotations

import ctypes
import os
import re
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from worlds import replayed, straight_road

from interplan_planners.straight_ahead import StraightAhead
from interplan_sumo.errors import PlannerError, PlannerLoadError
from interplan_sumo.planner_process.family import descendants
from interplan_sumo.planner_process.process import PlannerLimits, PlannerProcess
from interplan_sumo.planner_seat import PlannerSeat
from interplan_sumo.scenario.scenario import LanePosition, Scenario
from interplan_sumo.simulation.episode import Episode, EpisodeOptions, run_loop
from tests.planner_process import hostile_planners
from tests.quick import nightly, slow

ROADS = straight_road(lanes=2, length_m=400.0)
SCENE = Scenario(
    id="test/0",
    family="test",
    map="test",
    start=LanePosition("11", 20.0),
    start_speed_mps=10.0,
    goal=LanePosition("11", 390.0),
    route=("1",),
    duration_s=0.6,
)
QUICK = PlannerLimits(call_s=0.5, load_s=30.0, memory_bytes=1 << 30)


def driven(seat: PlannerSeat | StraightAhead) -> Episode:
    return run_loop(SCENE, ROADS, seat, replayed(), options=EpisodeOptions(), on_phase=lambda _: None)


def hash_of(episode: Episode) -> str:
    assert episode.trace is not None
    return episode.trace.hash()


HONEST = hash_of(driven(StraightAhead()))


def hostile(how: str, mark: Path | str = "", limits: PlannerLimits = QUICK) -> PlannerProcess:
    return PlannerProcess.of(f"tests.planner_process.hostile_planners:Hostile?how={how}&mark='{mark}'", limits)


PAGE = (Path(__file__).parents[2] / "docs" / "hostile_planners.md").read_text(encoding="utf-8")


def rows_of(heading: str, end: str = "\n## ") -> list[list[str]]:
    """What the page has below a heading: `how` and, where it is there, what is said."""
    section = PAGE.partition(f"{heading}\n")[2].partition(end)[0]
    rows = [line.strip("| ").split(" | ") for line in section.splitlines() if line.startswith("| `")]
    return [[row[0].strip("`"), *row[2:]] for row in rows[1:]]


FAULTS = [
    (how, said.strip("`") if said.startswith("`") else "")
    for how, said in rows_of("## One planner fault", "One that cannot be built")
]
UNBUILT = [(how, said.strip("`")) for how, said in rows_of("with exit code 2:")]
HARMLESS = [how for (how,) in rows_of("## Without effect") + rows_of("## Cheats on what it can reach")]
LIKE_ANOTHER = {how for number, (how, said) in enumerate(FAULTS) if said in {each for _, each in FAULTS[:number]}}
"""These end with the words of one before them."""
HASTY = {
    "exit in start", "raise", "crash", "sleep in C", "babble", "eat memory", "fork and exit", "exit in report",
    "move the ego", "patch the score", "walk the frames", "raise while it is built",
}  # fmt: skip
"""These run in a hurry."""
LANDLOCK = {"write to who simulates": 1, "signal who simulates": 6}
"""These are kept from other processes by this version of it: that of Linux 5.13, and of 6.12."""
ELSEWHERE = {"be killed once"}
"""What an operator does is no fault: tests/batch/test_run.py."""
SHORT = PlannerLimits(load_s=30.0)
"""Of nobody who takes long."""
SAID = {
    "raise in report": "{'error': 'report() raised ValueError: nothing to say (hostile_planners.py:",
    "report a number": "{'error': 'report() gave a int'}",
    "report a surrogate": "report() raised UnicodeEncodeError",
    "report what is no number": "{'loss': nan, 'queries': -1}",
}
"""Of a report."""


def in_a_hurry(cases: list[Any]) -> list[Any]:
    """The cases, those that are not quick marked as slow, or as nightly if another ends as they do."""
    names = [case if isinstance(case, str) else case[0] for case in cases]
    return [
        case if name in HASTY else nightly(case) if name in LIKE_ANOTHER else slow(case)
        for name, case in zip(names, cases, strict=True)
    ]


def test_the_page_has_every_hostile_planner_once_and_no_other() -> None:
    listed = [how for how, _ in FAULTS + UNBUILT] + HARMLESS
    known = re.findall(r'(?:case|how ==) "([^"]+)"', Path(hostile_planners.__file__).read_text(encoding="utf-8"))
    assert len(listed) == len(set(listed)) >= 45
    assert set(known) - set(listed) == ELSEWHERE
    assert set(listed) <= set(known)


def landlock() -> int:
    """Its version here, 0 or less without it."""
    return ctypes.CDLL(None).syscall(444, None, 0, 1) if sys.platform == "linux" else 0


def fault_of(seat: PlannerProcess) -> str:
    """Why this planner gets nothing: by its drive, or by its report on one."""
    episode = driven(seat)
    if episode.fault is not None:
        assert episode.fault.kind == "planner"
        return episode.fault.message
    with pytest.raises(PlannerError) as caught:
        seat.report()
    assert seat.report() is None
    return str(caught.value)


@pytest.mark.parametrize(("how", "words"), in_a_hurry(FAULTS))
def test_a_planner_that_misbehaves_is_one_planner_fault(how: str, words: str, tmp_path: Path) -> None:
    began_s, before = time.monotonic(), descendants(os.getpid())
    with hostile(how, tmp_path / "mark") as seat:
        message = fault_of(seat)
    assert words in message
    assert message.isprintable()
    assert len(message) < 600
    message.encode()
    assert seat.killed_from_outside == (how == "kill itself")
    assert set(descendants(os.getpid())) <= set(before)
    assert hash_of(driven(StraightAhead())) == HONEST
    assert time.monotonic() - began_s < 30.0


@pytest.mark.parametrize("how", in_a_hurry(HARMLESS))
def test_what_it_changes_is_its_own_alone(how: str, tmp_path: Path) -> None:
    if landlock() < LANDLOCK.get(how, landlock()):
        pytest.skip(f"needs version {LANDLOCK[how]} of Landlock")
    before = descendants(os.getpid())
    with hostile(how, tmp_path / "mark", SHORT) as seat:
        episode, said = driven(seat), seat.report()
    assert episode.fault is None
    assert hash_of(episode) == HONEST == hash_of(driven(StraightAhead()))
    assert SAID.get(how, "None") in str(said)
    assert set(descendants(os.getpid())) <= set(before)
    if how == "leave a daemon":
        place = Path("/proc", (tmp_path / "mark").read_text(), "cmdline")
        assert not place.exists() or not place.read_bytes()  # gone, or a zombie that init has yet to reap


@pytest.mark.parametrize(("how", "words"), in_a_hurry(UNBUILT))
def test_one_that_cannot_be_built_says_why(how: str, words: str) -> None:
    before = descendants(os.getpid())
    with pytest.raises(PlannerLoadError) as caught:
        hostile(how)
    assert words in str(caught.value)
    assert set(descendants(os.getpid())) <= set(before)
