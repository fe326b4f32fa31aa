"""A planner in a process of its own drives as it does in this one, in whatever language it is written."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import shapely
from test_hostile_planners import ROADS, SCENE, driven, hash_of
from worlds import replayed, rolling

from interplan_planners.straight_ahead import StraightAhead
from interplan_sumo import testing
from interplan_sumo._check_worlds import check_worlds
from interplan_sumo.errors import PlannerError, PlannerLoadError, TrafficError
from interplan_sumo.maps.store import load_roads
from interplan_sumo.planner import Observation, find_planner, load_planner
from interplan_sumo.planner_process.map_message import as_sent
from interplan_sumo.planner_process.process import MOST_MAPS, PlannerLimits, PlannerProcess
from interplan_sumo.planner_seat import InProcess, PlannerSeat, TimedPlan
from interplan_sumo.simulation.episode import EpisodeOptions, run_loop
from interplan_sumo.testing import check_planner
from interplan_sumo.world.roads import LaneLike

EXAMPLES = Path(__file__).parents[2] / "planners" / "examples"
PYTHON = f"exec:{sys.executable} -S {EXAMPLES / 'python' / 'straight.py'}"


@pytest.mark.parametrize("name", ["idm", "pdm_closed"])
def test_a_drive_has_the_same_hash_in_this_process_and_in_its_own(name: str) -> None:
    car = rolling("c", ROADS["11"].centerline, 60.0, 5.0)

    def drive(seat: PlannerSeat) -> str:
        traffic = replayed(car)
        return hash_of(run_loop(SCENE, ROADS, seat, traffic, options=EpisodeOptions(), on_phase=lambda _: None))

    with PlannerProcess.of(name) as seat:
        assert drive(seat) == drive(InProcess(load_planner(name))) == drive(seat)


def test_a_map_comes_through_to_the_last_bit() -> None:
    roads = load_roads("back_bay")
    sent = as_sent(roads)

    def bits(lane: LaneLike) -> tuple[bytes, ...]:
        lines = (lane.centerline, lane.left_boundary, lane.right_boundary)
        arrays = [each for line in lines for each in (line.points, line.arc_m)]
        return (*(each.tobytes() for each in arrays), shapely.to_wkb(lane.polygon))

    for one, other in ((roads.lanes, sent.lanes), (roads.connectors, sent.connectors)):
        assert list(one) == list(other)
        assert all(bits(one[id]) == bits(other[id]) for id in one)
    assert [shapely.to_wkb(b.polygon) for b in roads.roadblocks.values()] == [
        shapely.to_wkb(b.polygon) for b in sent.roadblocks.values()
    ]
    assert {b.id: (b.lane_ids, b.from_id, b.to_id) for b in roads.roadblocks.values()} == {
        b.id: (b.lane_ids, b.from_id, b.to_id) for b in sent.roadblocks.values()
    }
    assert (roads.crs, roads.driving_side, len(roads.crosswalks)) == (sent.crs, sent.driving_side, len(sent.crosswalks))


def test_one_process_serves_many_drives_and_keeps_the_last_maps() -> None:
    worlds = check_worlds()
    with PlannerProcess.of(PYTHON) as seat:
        for round_ in range(2):
            for world in worlds:
                seat.start(world.mission)
                plan = seat.plan(world.observation(world.ego, [])).plan
                assert plan.x_m[0] == world.ego.x_m, (round_, world.name)
    assert len(worlds) < MOST_MAPS


def test_a_process_that_somebody_kills_says_so_and_is_asked_no_more() -> None:
    with PlannerProcess.of(PYTHON) as seat:
        world = check_worlds()[0]
        seat.start(world.mission)
        os.kill(seat.pid, signal.SIGTERM)
        with pytest.raises(PlannerError, match=r"was killed by SIGTERM inside plan\(\)"):
            seat.plan(world.observation(world.ego, []))
        assert seat.killed_from_outside
        with pytest.raises(PlannerError, match="has ended"):
            seat.start(world.mission)


def test_a_program_may_take_its_time_for_a_map_when_it_is_checked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text, asked = (EXAMPLES / "python" / "straight.py").read_text(), "            request = json.loads(line)\n"
    assert asked in text
    slow = "            import time\n            time.sleep(0.3 * (request['type'] == 'map'))\n"
    (tmp_path / "slow.py").write_text(text.replace(asked, asked + slow))
    monkeypatch.setattr(testing, "CALL_LIMIT_S", 0.2)
    found = check_planner(f"exec:{sys.executable} -S {tmp_path / 'slow.py'}", steps=2)
    assert [finding for finding in found if finding.severity == "error"] == []


def test_time_that_two_spend_at_once_makes_no_part_of_a_drive_negative() -> None:
    class Thinking(InProcess):
        """Plans for as long as the agents take to react."""

        def plan_while(self, observation: Observation, meanwhile: Callable[[], object]) -> TimedPlan:
            began_s = time.perf_counter()
            meanwhile()
            timed = self.plan(observation)
            return TimedPlan(timed.plan, 20.0 * (time.perf_counter() - began_s))

    episode = driven(Thinking(StraightAhead()))
    assert episode.fault is None
    assert min(episode.times_s.values()) >= 0.0


@pytest.mark.parametrize("planner", [PYTHON, "straight_ahead"], ids=["told by nobody", "told by itself"])
def test_what_is_done_while_it_thinks_is_not_counted_as_its_time(planner: str) -> None:
    with PlannerProcess.of(planner) as seat:
        world = check_worlds()[0]
        seat.start(world.mission)
        seen = world.observation(world.ego, [])
        took_s = [seat.plan_while(seen, lambda: time.sleep(0.5)).wall_s for _ in range(2)]
    assert max(took_s) < 0.4


def test_what_fails_while_it_thinks_is_not_its_fault_and_its_answer_is_not_waited_for() -> None:
    def fail() -> None:
        raise TrafficError("SUMO gave up")

    with PlannerProcess.of("straight_ahead") as seat:
        world = check_worlds()[0]
        seat.start(world.mission)
        seat.plan(world.observation(world.ego, []))
        with pytest.raises(TrafficError):
            seat.plan_while(world.observation(world.ego, []), fail)
        assert seat.has_ended
        assert not seat.killed_from_outside


@pytest.mark.parametrize(
    ("code", "words"),
    [
        ("", "its process exited with code 0 while it was built"),
        ("print('hello'); os.write(4, b'hello\\n')", "was not answered as the protocol has it"),
        ("""os.write(4, b'{"protocol": "interplan-sumo/planner", "versions": [2]}\\n')""", "speaks versions [2]"),
        ("""os.write(4, b'{"protocol": "interplan-sumo/planner", "error": "no licence"}\\n')""", "no licence"),
        ("os.write(4, b'x' * 70000)", "wrote a line of more than 65536 bytes"),
        ("time.sleep(600)", "took longer than 0.3 s"),
    ],
)
def test_a_program_that_does_not_greet_cannot_be_built(code: str, words: str, tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text(f"import os, time\n{code}\n")
    with pytest.raises(PlannerLoadError) as caught:
        PlannerProcess.of(
            f"exec:{sys.executable} -I -S {program}", PlannerLimits(load_s=0.3 if "sleep" in code else 20)
        )
    assert words in str(caught.value)


def test_a_program_that_is_not_there_is_named_before_anything_is_started() -> None:
    with pytest.raises(PlannerLoadError, match=r"there is no program '\./nothing'"):
        find_planner("exec:./nothing --speed 3")
    with pytest.raises(PlannerLoadError, match="is no command: No closing quotation"):
        find_planner("exec:./nothing 'x")


def test_a_planner_gets_its_pipes_and_nothing_else(tmp_path: Path) -> None:
    listing = tmp_path / "listing"
    program = tmp_path / "program.py"
    program.write_text(f"import os\nopen({str(listing)!r}, 'w').write(' '.join(sorted(os.listdir('/proc/self/fd'))))\n")
    secret = os.open("/dev/null", os.O_RDONLY)
    os.set_inheritable(secret, True)
    with pytest.raises(PlannerLoadError):
        PlannerProcess.of(f"exec:{sys.executable} -I -S {program}")
    os.close(secret)
    # 0 to 4, what Python opens to list them, and the listing itself
    assert listing.read_text().split() in (["0", "1", "2", "3", "4", "5"], ["0", "1", "2", "3", "4", "5", "6"])


# --- the examples --------------------------------------------------------------------------------


@cache
def built(language: str) -> str:
    """An example as a command; skips without its compiler."""
    folder = EXAMPLES / language
    program = Path(os.environ.get("TMPDIR", "/tmp"), f"interplan-example-{language}-{os.getpid()}")
    build = {"cpp": ["g++", "-O1", "-std=c++20", "lane_follower.cpp"], "rust": ["rustc", "-O", "lane_follower.rs"]}
    if shutil.which(build[language][0]) is None:
        pytest.skip(f"no {build[language][0]}")
    subprocess.run([*build[language], "-o", program], cwd=folder, check=True)
    return f"exec:{program} --speed 12"


@pytest.mark.slow
@pytest.mark.parametrize("language", ["cpp", "rust"])
def test_an_example_conforms_stops_at_red_and_behind_what_stands(language: str) -> None:
    findings = check_planner(built(language))
    assert [str(each) for each in findings if each.severity == "error" or each.rule == "drives"] == []


@pytest.mark.slow
def test_both_languages_and_both_forms_drive_alike() -> None:
    with PlannerProcess.of(built("cpp")) as one, PlannerProcess.of(built("rust")) as other:
        for world in check_worlds():
            plans = []
            for seat in (one, other):
                seat.start(world.mission)
                plans.append(seat.plan(world.observation(world.ego, [])).plan)
            assert np.abs(plans[0].poses_at(plans[0].time_s) - plans[1].poses_at(plans[0].time_s)).max() < 1e-9


def test_the_example_in_python_conforms() -> None:
    assert [str(each) for each in check_planner(PYTHON, steps=5) if each.severity == "error"] == []


def test_what_it_drives_is_what_the_planner_in_this_process_drives() -> None:
    with PlannerProcess.of(PYTHON) as seat:
        assert driven(seat).fault is None
