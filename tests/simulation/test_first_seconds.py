"""In their first two seconds agents keep their lanes and brake mildly, whatever model they drive by."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from networks import agent, ego_at, traffic, types
from test_late_for_light import MAP as LIGHTS_MAP
from test_late_for_light import crossing, types_of
from test_right_of_way import first_crossing

from interplan_sumo.maps.network import NetworkIds
from interplan_sumo.maps.store import find_map, load_roads
from interplan_sumo.scenario.suite import find_scenario
from interplan_sumo.simulation.agent_control import BRAKING_FOR_LANES, NEW_STEPS
from interplan_sumo.simulation.first_seconds import _Leader, _Line, _line
from interplan_sumo.simulation.lane_chains import continued_route
from interplan_sumo.simulation.network import NetworkLink, plain_ids, read_network
from interplan_sumo.simulation.obstacles import LaneBlockage
from interplan_sumo.simulation.setup import open_sumo_traffic
from interplan_sumo.simulation.spawning import Spawn
from interplan_sumo.simulation.start_speed import LINE_M
from interplan_sumo.simulation.sumo import sumo
from interplan_sumo.simulation.sumo_traffic import SumoTraffic, TrafficSetup
from interplan_sumo.simulation.traffic import EgoPresence
from interplan_sumo.simulation.vehicle_types import VehicleTypes, read_vehicle_types, vehicle_type_file
from tests.maps.sumo_nets import crossroads

MODELS = ("IDM", "Krauss", "KraussOrig1", "PWagner2009", "EIDM", "ACC", "CACC", "W99", "Wiedemann", "IDMM")
NOBODY = ego_at(1400.0, -1.75)
FIRST_S = 2.0


def speeds(behaviour: VehicleTypes, gap_m: float, speed_mps: float, leader_mps: float) -> list[float]:
    """Of one behind another, which goes on at its speed."""
    length_m = behaviour.members[0].length_m
    both = (
        agent(behaviour, "e0_0", 250.0, leader_mps),
        agent(behaviour, "e0_0", 250.0 - length_m - gap_m, speed_mps),
    )
    with traffic(behaviour, both, NOBODY, EgoPresence.ABSENT) as run:
        found: list[float] = []
        for _ in range(round(FIRST_S / 0.1) + 1):
            sumo.vehicle.setSpeed("a0", leader_mps)
            found.append(float(sumo.vehicle.getSpeed("a1")))
            run.react(NOBODY)
            run.advance()
    return found


@pytest.mark.parametrize("model", [model for model in MODELS if model != "CACC"])  # it jitters while it follows
def test_who_would_brake_hard_starts_slower_and_who_would_not_keeps_its_speed(model: str, tmp_path: Path) -> None:
    behaviour = types_of(model, tmp_path)
    near, far = speeds(behaviour, 15.0, 13.0, 5.0), speeds(behaviour, 150.0, 13.0, 13.0)
    assert near[0] < 13.0
    assert max(before - after for before, after in pairwise(near)) / 0.1 <= 3.0
    assert far[0] == pytest.approx(13.0)


@pytest.mark.parametrize("gap_m", [11.0, 16.0, 20.0])
def test_who_follows_those_that_will_brake_starts_slower(gap_m: float, tmp_path: Path) -> None:
    """Six at 9 m/s, one behind the other, the first of which drives 5 m/s: each is asked after all ahead of it."""
    behaviour = types_of("Wiedemann", tmp_path)
    length_m = behaviour.members[0].length_m
    spawns = tuple(agent(behaviour, "e0_0", 380.0 - i * (length_m + gap_m), 9.0 if i else 5.0) for i in range(6))
    found: list[list[float]] = []
    with traffic(behaviour, spawns, NOBODY, EgoPresence.ABSENT) as run:
        for _ in range(round(FIRST_S / 0.1) + 1):
            sumo.vehicle.setSpeed("a0", 5.0)
            found.append([sumo.vehicle.getSpeed(f"a{i}") for i in range(6)])
            run.react(NOBODY)
            run.advance()
    assert np.diff(found, axis=0).min() / 0.1 >= -3.0


def test_nobody_changes_lane_in_its_first_two_seconds_but_later() -> None:
    """Behind a slow one, with a free lane beside it."""
    behaviour = types("assertive")
    both = (agent(behaviour, "e0_1", 120.0, 3.0), agent(behaviour, "e0_1", 90.0, 8.0))
    lanes: list[float] = []
    with traffic(behaviour, both, NOBODY, EgoPresence.ABSENT) as run:
        for _ in range(100):
            sumo.vehicle.setSpeed("a0", 3.0)
            lanes.append(abs(sumo.vehicle.getLateralLanePosition("a1")) + 3.5 * (sumo.vehicle.getLaneIndex("a1") != 1))
            run.react(NOBODY)
            run.advance()
    assert max(lanes[:NEW_STEPS]) == 0.0
    assert max(lanes) > 1.0


@pytest.mark.nightly
@pytest.mark.parametrize("model", [model for model in MODELS if model != "PWagner2009"])  # it brakes hard by chance
def test_on_the_maps_who_starts_and_who_comes_later_brakes_mildly(model: str, tmp_path: Path) -> None:
    scenario = find_scenario("lane_change_htd/5")
    types_of(model, tmp_path)
    hard, many, since, before = 0, 0, dict[str, int](), dict[str, float]()
    with open_sumo_traffic(
        scenario, load_roads(scenario.map), vehicle_types=tmp_path / f"{model}.xml", presence=EgoPresence.ABSENT
    ) as run:
        for step in range(200):
            now = run.observe().actors
            there = dict(zip(now.ids, now.speed_mps.tolist(), strict=True))
            for name in there:
                if step - since.setdefault(name, step) < FIRST_S / 0.1 and name in before:
                    hard += (before[name] - there[name]) / 0.1 > 3.05
            before, many = there, len(since)
            run.react(NOBODY)
            run.advance()
    assert many > 25
    assert hard == 0
    assert np.mean(list(before.values())) > 1.0


@pytest.mark.parametrize(("closings", "mild"), [((0,), True), ((19,), False), ((0, 7, 14, 19), False)])
def test_a_line_that_may_close_at_any_moment_is_mild_only_if_it_is_at_each(
    closings: tuple[int, ...], mild: bool
) -> None:
    behaviour = types("conservative")
    with traffic(behaviour, (agent(behaviour, "e0_0", 100.0, 9.0),), NOBODY) as run:
        line = _Line(32.0, closings, light=False)
        assert run._first_seconds._comes_through("a0", 9.0, (), line) is mild


def test_who_comes_while_somebody_crosses_its_way_starts_slower() -> None:
    """It has the right of way, but SUMO's cars keep behind whoever is in the junction already."""
    junction = first_crossing("one_north")
    files, behaviour = find_map(junction.map), types("conservative")
    network = read_network(files.network)

    def start(link: NetworkLink, before_m: float, speed_mps: float) -> Spawn:
        lane = network.lanes[link.from_lane]
        route = (lane.edge, *continued_route(network, link.to_lane, 200.0))
        return Spawn(lane.id, lane.length_m - before_m, speed_mps, behaviour.members[0], route)

    def comes_mps(*, beside_m: float) -> float:
        """How fast one starts 20 m before a junction, a while after another has set out so far before it."""
        setup = TrafficSetup(
            network, NetworkIds.read(files.ids), behaviour, NOBODY, (), presence=EgoPresence.ABSENT,
            spawns=(start(junction.second, beside_m, 0.0),), tokens=("a",),
        )  # fmt: skip
        with SumoTraffic(setup) as run:
            for _ in range(25):
                run.react(NOBODY)
                run.advance()
            run._add("b", start(junction.first, 20.0, 10.0))
            run.advance()
            return float(sumo.vehicle.getSpeed("a1"))

    assert comes_mps(beside_m=60.0) == pytest.approx(10.0)
    assert comes_mps(beside_m=1.0) < 9.5


@pytest.mark.parametrize(("after_steps", "slower"), [(40, True), (0, False)])
def test_so_it_does_where_sumo_does_not_tell_of_the_other(after_steps: int, slower: bool, tmp_path: Path) -> None:
    """At wide junctions of roads with several lanes `getJunctionFoes` leaves some out; those not in it yet yield."""
    network = read_network(crossroads(tmp_path, "priority", "--default.junctions.radius", "25", lanes=2))
    behaviour = types("conservative")

    def start(route: tuple[str, str], lane: int, before_m: float, speed_mps: float) -> Spawn:
        here = network.lanes[f"{route[0]}_{lane}"]
        return Spawn(here.id, here.length_m - before_m, speed_mps, behaviour.members[0], route)

    setup = TrafficSetup(
        network, plain_ids(network), behaviour, NOBODY, (), presence=EgoPresence.ABSENT,
        spawns=(start(("sc", "cw"), 0, 1.0, 0.0),), tokens=("a",),
    )  # fmt: skip
    with SumoTraffic(setup) as run:
        for _ in range(after_steps):
            sumo.vehicle.setSpeed("a0", 2.0)
            run.react(NOBODY)
            run.advance()
        run._add("b", start(("wc", "ce"), 1, 22.0, 10.0))
        run.advance()
        assert sumo.vehicle.getJunctionFoes("a1", 80.0) == () or not slower
        assert (sumo.vehicle.getSpeed("a1") < 9.5) is slower


@pytest.mark.parametrize(("gap_m", "slower"), [(9.6, True), (12.0, False)])
def test_nobody_starts_so_fast_that_it_would_touch_the_next_one_within_three_seconds(
    gap_m: float, slower: bool
) -> None:
    """At 6.7 m/s behind 3.1 m/s, 3 s end 0.5 m behind it from 11.3 m on; mild braking would do from much nearer."""
    assert (speeds(types("assertive"), gap_m, 6.7, 3.1)[0] < 6.7) is slower


@pytest.mark.parametrize(("share", "mildly"), [(1.0, True), (1.01, True), (1.04, False)])
def test_who_errs_is_placed_no_faster_than_its_driver_wants_to_drive(
    share: float, mildly: bool, tmp_path: Path
) -> None:
    behaviour = types_of("EIDM", tmp_path)
    wants_mps = 15.0 * behaviour.members[0].speed_factor
    placed = agent(behaviour, "e0_0", 100.0, share * wants_mps)
    with traffic(behaviour, (placed,), NOBODY, EgoPresence.ABSENT):
        assert (sumo.vehicle.getSpeed("a0") == pytest.approx(placed.speed_mps)) is mildly


@pytest.mark.parametrize(("gap_m", "stays"), [(5.0, False), (60.0, True)])
def test_who_comes_later_stays_only_if_nobody_behind_it_brakes_hard(gap_m: float, stays: bool) -> None:
    behaviour = types("conservative")
    with traffic(behaviour, (agent(behaviour, "e0_0", 100.0, 13.0),), NOBODY, EgoPresence.ABSENT) as run:
        run._add("b", agent(behaviour, "e0_0", 101.3 + behaviour.members[0].length_m + gap_m, 8.0))
        run.advance()
        assert ("a1" in sumo.vehicle.getIDList()) is stays
        assert ("b" in run.behaviours) is stays


@pytest.mark.parametrize("switches_s", [1.6, 20.0])
@pytest.mark.parametrize("drawn", [True, False])
def test_who_stands_before_a_light_about_to_switch_is_left_out_unless_the_scenario_places_it(
    switches_s: float, drawn: bool
) -> None:
    """It would set out, and brake hard 1.6 s later."""
    network, link = crossing()
    files, behaviour = find_map(LIGHTS_MAP), read_vehicle_types(vehicle_type_file("measured_city_bold"))
    lane = network.lanes[link.from_lane]
    route = (lane.edge, *continued_route(network, link.to_lane, 200.0))
    spawn = Spawn(lane.id, lane.length_m - 3.9, 0.0, behaviour.members[0], route)
    setup = TrafficSetup(
        network, NetworkIds.read(files.ids), behaviour, NOBODY, (), presence=EgoPresence.ABSENT,
        spawns=(spawn,), tokens=("a",),
    )  # fmt: skip
    with SumoTraffic(setup) as run:
        light, index = link.light or ("", 0)
        lights, now = sumo.trafficlight, sumo.trafficlight.getAllProgramLogics(light)[0]
        lights.setPhase(light, next(i for i, phase in enumerate(now.phases) if phase.state[index] == "G"))
        lights.setPhaseDuration(light, switches_s)
        left_out = drawn and switches_s < 2.0
        assert run._settled({"a0": replace(spawn, drawn=drawn)}) == (set() if left_out else {"a0"})


@pytest.mark.parametrize(("brakes_mps2", "slower"), [(0.0, False), (3.0, True)])
def test_who_comes_behind_one_that_brakes_already_reckons_that_it_goes_on(
    brakes_mps2: float, slower: bool, tmp_path: Path
) -> None:
    behaviour = types_of("EIDM", tmp_path)
    with traffic(behaviour, (agent(behaviour, "e0_0", 150.0, 12.0),), NOBODY, EgoPresence.ABSENT) as run:
        for step in range(4):
            sumo.vehicle.setSpeed("a0", 12.0 - brakes_mps2 * 0.1 * step)
            run.react(NOBODY)
            run.advance()
        there_m = sumo.vehicle.getLanePosition("a0")
        mps = float(sumo.vehicle.getSpeed("a0"))
        run._add("b", agent(behaviour, "e0_0", there_m - behaviour.members[0].length_m - 12.0, mps))
        sumo.vehicle.setSpeed("a0", mps - brakes_mps2 * 0.1)
        run.advance()
        assert (sumo.vehicle.getSpeed("a1") < mps - 0.05) is slower


@pytest.mark.parametrize(("at_m", "slower"), [(125.0, True), (330.0, False)])
def test_who_comes_before_somebody_that_stands_in_its_lane_starts_slower(
    at_m: float, slower: bool, tmp_path: Path
) -> None:
    """People are no vehicles of SUMO's: its cars know of them from us."""
    behaviour = types_of("Wiedemann", tmp_path)
    with traffic(behaviour, (agent(behaviour, "e0_1", 300.0, 10.0),), NOBODY, EgoPresence.ABSENT) as run:
        run._first_seconds._waiting = lambda: (LaneBlockage("e0_0", at_m, at_m + 1.0),)
        run._add("b", agent(behaviour, "e0_0", 100.0, 10.0))
        run.advance()
        assert (sumo.vehicle.getSpeed("a1") < 9.5) is slower


def test_who_has_just_come_brakes_for_no_lane_change_of_its_own_or_of_others() -> None:
    """It may not change yet, and has not settled."""
    behaviour = types("conservative")
    with traffic(behaviour, (agent(behaviour, "e0_1", 120.0, 8.0),), NOBODY, EgoPresence.ABSENT) as run:
        for key, value in BRAKING_FOR_LANES.items():
            assert float(sumo.vehicle.getParameter("a0", key)) == float(value)
        for _ in range(NEW_STEPS):
            run.react(NOBODY)
            run.advance()
        assert [float(sumo.vehicle.getParameter("a0", key)) for key in BRAKING_FOR_LANES] == [1.0, 1.0]


@pytest.mark.parametrize(("towards", "slower"), [(0, True), (2, False)])
def test_who_comes_behind_somebody_that_changes_into_its_lane_starts_slower(towards: int, slower: bool) -> None:
    behaviour = types("conservative")
    with traffic(behaviour, (agent(behaviour, "e0_1", 120.0, 6.0),), NOBODY, EgoPresence.ABSENT) as run:
        sumo.vehicle.setMaxSpeed("a0", 6.0)
        for _ in range(NEW_STEPS):
            run.react(NOBODY)
            run.advance()
        sumo.vehicle.changeLane("a0", towards, 10.0)
        for _ in range(3):
            run.react(NOBODY)
            run.advance()
        run._add("b", agent(behaviour, "e0_0", sumo.vehicle.getLanePosition("a0") - 14.0, 10.0))
        run.advance()
        assert (sumo.vehicle.getSpeed("a1") < 9.5) is slower


def test_the_next_line_may_be_behind_other_junctions() -> None:
    """Of the kind that has to yield, behind one where it has the right of way."""
    network, behaviour = read_network(find_map("paradise").network), types("conservative")
    first, second = next(
        (first, second)
        for lane in network.lanes.values()
        for first in network.links.get(lane.id, ())
        for second in network.links.get(first.to_lane, ())
        if first.major and not second.major and first.light is None and second.light is None
        and lane.length_m > 20.0 and network.lanes[first.to_lane].length_m < 60.0
    )  # fmt: skip
    lane, then = network.lanes[first.from_lane], network.lanes[first.to_lane]
    route = (lane.edge, then.edge, network.lanes[second.to_lane].edge)
    spawn = Spawn(lane.id, lane.length_m - 5.0, 5.0, behaviour.members[0], route)
    setup = TrafficSetup(
        network, NetworkIds.read(find_map("paradise").ids), behaviour, NOBODY, (), presence=EgoPresence.ABSENT,
        spawns=(spawn,), tokens=("a",),
    )  # fmt: skip
    with SumoTraffic(setup):
        line = _line("a0")
        way_m = 5.0 + sum(network.lanes[inner].length_m for inner in first.via) + then.length_m
        assert line is not None
        assert line.away_m == pytest.approx(way_m - LINE_M, abs=0.1)


@pytest.mark.parametrize(("light_m", "minds"), [(100.0, True), (20.0, False)])
def test_who_crosses_the_way_matters_unless_a_light_holds_one_before(light_m: float, minds: bool) -> None:
    behaviour = types("conservative")
    with traffic(behaviour, (agent(behaviour, "e0_0", 100.0, 10.0),), NOBODY) as run:
        crossing = _Leader("", 10.0, [0.0], crosses_m=40.0)
        light = _Line(light_m, (19,), light=True)
        speeds_mps = run._first_seconds._driven("a0", 10.0, (crossing,), light, 19)
        assert (min(speeds_mps[:19]) < 9.0) is minds
