"""Whatever a planner does to its process is one planner fault or nothing, and no other drive knows of it."""

from __future__ import annotations

import os
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


FAULTS = [
    ("raise in start", "start() raised ValueError: no model for tiny_road (hostile_planners.py:"),
    ("exit in start", "its process exited with code 3 inside start()"),
    ("raise", "plan() raised ValueError: I cannot see (hostile_planners.py:"),
    ("exit", "its process exited with code 3 inside plan()"),
    ("crash", "its process was killed by SIGSEGV inside plan()"),
    ("sleep in C", "plan() took longer than 0.5 s"),
    ("stop itself", "plan() took longer than 0.5 s"),
    ("babble", "plan() announced a message of 1701995880 bytes, at most 1048576 may come"),
    ("close everything", "inside plan()"),
    ("eat memory", "plan() raised MemoryError"),
    ("fork and exit", "its process exited with code 0 inside plan()"),
]
MORE_FAULTS = [
    ("hang in start", "start() took longer than 0.5 s"),
    ("raise a surrogate", "plan() raised ValueError: \\ud800\\x1b[2Jxxx"),
    ("raise without words", "plan() raised UnspeakableError: an error without a text"),
    ("raise an interrupt", "plan() raised KeyboardInterrupt"),
    ("raise the end of generators", "plan() raised GeneratorExit"),
    ("recurse", "plan() raised RecursionError"),
    ("leave", "plan() raised SystemExit: enough"),
    ("kill itself", "its process was killed by SIGKILL inside plan()"),
    ("loop", "plan() took longer than 0.5 s"),
    ("be deaf and loop", "plan() took longer than 0.5 s"),
    ("fork many", "plan() raised RuntimeError: enough"),
    ("flood without end", "plan() took longer than 0.5 s"),
    ("flood the channel", "plan() announced a message of"),
    ("lie about a length", "plan() announced a message of 2147483648 bytes"),
    ("say half", "plan() took longer than 0.5 s"),
    ("say half and exit", "its process exited with code 0 inside plan()"),
    ("drip", "plan() took longer than 0.5 s"),
    ("forge a reply", "plan() was not answered as the protocol has it"),
    ("nest", "plan() was not answered as the protocol has it"),
    ("break the interpreter", ""),
    ("return nothing", "the plan is of type int"),
    ("return what is no number", "Trajectory.x_m holds a number that is not finite"),
    ("return texts", "plan() raised ValueError"),
    ("return columns of other lengths", "Trajectory.x_m has shape (3,)"),
    ("return far too much", "plan() announced a message of"),
    ("jump", "the plan is 50.00 m away from the ego"),
]
HARMLESS = ["fork", "flood what it prints to", "move the ego", "patch the score", "walk the frames", "never end"]
MORE_HARMLESS = ["leave a daemon", "close what it prints to", "leave threads", "write to the scene", "patch the clock"]


def check_fault(how: str, words: str, tmp_path: Path) -> None:
    began_s, before = time.monotonic(), descendants(os.getpid())
    with hostile(how, tmp_path / "mark") as seat:
        episode = driven(seat)
    assert episode.fault is not None, how
    assert episode.fault.kind == "planner"
    assert words in episode.fault.message
    assert "\n" not in episode.fault.message
    assert len(episode.fault.message) < 600
    episode.fault.message.encode()
    assert seat.killed_from_outside == (how == "kill itself")
    assert set(descendants(os.getpid())) <= set(before)
    assert hash_of(driven(StraightAhead())) == HONEST
    assert time.monotonic() - began_s < 30.0


@pytest.mark.parametrize(("how", "words"), FAULTS)
def test_a_planner_that_misbehaves_is_one_planner_fault(how: str, words: str, tmp_path: Path) -> None:
    check_fault(how, words, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize(("how", "words"), MORE_FAULTS)
def test_one_that_misbehaves_in_another_way_is_one_too(how: str, words: str, tmp_path: Path) -> None:
    check_fault(how, words, tmp_path)


def check_harmless(how: str, tmp_path: Path) -> None:
    before = descendants(os.getpid())
    with hostile(how, tmp_path / "mark", PlannerLimits(load_s=30.0)) as seat:
        episode = driven(seat)
    assert episode.fault is None
    assert hash_of(episode) == HONEST == hash_of(driven(StraightAhead()))
    assert set(descendants(os.getpid())) <= set(before)
    if how == "leave a daemon":
        place = Path("/proc", (tmp_path / "mark").read_text(), "cmdline")
        assert not place.exists() or not place.read_bytes()  # gone, or a zombie that init has yet to reap


@pytest.mark.parametrize("how", HARMLESS)
def test_what_it_changes_is_its_own_alone(how: str, tmp_path: Path) -> None:
    check_harmless(how, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("how", MORE_HARMLESS)
def test_what_else_it_changes_is_its_own_too(how: str, tmp_path: Path) -> None:
    check_harmless(how, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("how", "said"),
    [
        ("raise in report", {"error": "report() raised ValueError: nothing to say (hostile_planners.py:52 in report)"}),
        ("report a number", {"error": "report() gave a int"}),
        ("report nothing", None),
    ],
)
def test_a_report_that_is_none_is_no_fault(how: str, said: dict[str, Any] | None) -> None:
    with hostile(how) as seat:
        assert driven(seat).fault is None
        assert seat.report() == said


@pytest.mark.slow
@pytest.mark.parametrize(
    ("how", "words"),
    [
        ("exit in report", r"its process exited with code 0 inside report\(\)"),
        ("hang in report", r"report\(\) took longer than 0\.5 s"),
        ("report a million texts", r"report\(\) announced a message"),
    ],
)
def test_one_that_ends_in_its_report_is_at_fault(how: str, words: str) -> None:
    with hostile(how) as seat:
        assert driven(seat).fault is None
        with pytest.raises(PlannerError, match=words):
            seat.report()
        assert seat.report() is None


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ("raise while it is built", "could not be built: RuntimeError: no weights"),
        ("exit while it is built", "exited with code 7 while it was built; it printed last: these are my last words"),
    ],
)
def test_one_that_cannot_be_built_says_why(how: str, words: str) -> None:
    before = descendants(os.getpid())
    with pytest.raises(PlannerLoadError) as caught:
        hostile(how)
    assert words in str(caught.value)
    assert set(descendants(os.getpid())) <= set(before)
