"""The simulation on a shipped map: lights as SUMO has them, equal hashes, faults named."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import libsumo
import numpy as np
import pytest
from random_drives import overlapping, random_scenario

from interplan_planners.idm import IdmPlanner
from interplan_planners.straight_ahead import StraightAhead
from interplan_sumo.errors import MapError, TrafficError
from interplan_sumo.maps.network import NetworkIds
from interplan_sumo.maps.store import MapFiles, find_map, load_roads
from interplan_sumo.scenario.scenario import Jaywalker, LanePosition, Obstacle, Scenario, TrafficDemand
from interplan_sumo.simulation import setup
from interplan_sumo.simulation.agent_control import LANE_CHANGE_DEFAULT, NEW_STEPS
from interplan_sumo.simulation.ego_proxy import NO_LANE_CHANGE
from interplan_sumo.simulation.episode import drive
from interplan_sumo.simulation.traffic import EgoPresence
from interplan_sumo.simulation.vehicle_types import vehicle_type_file
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.geometry import box_corners, penetration_m
from interplan_sumo.world.signals import SignalStatus
from tests.quick import DISTRICTS, few
from tests.scenes import scene

LTD = scene("lane_change_ltd/0")
HTD = scene("lane_change_htd/0")
STEPS = 400
"""Longer than the longest green of a shipped map."""


def test_the_lights_that_planners_see_are_sumos_at_every_step() -> None:
    ids = NetworkIds.read(find_map(LTD.map).ids)
    ego = setup.start_state(LTD, load_roads(LTD.map))
    seen: set[SignalStatus] = set()
    with setup.open_traffic(LTD, load_roads(LTD.map)) as traffic:
        for _ in range(400):
            signals = traffic.observe().signals
            for connector, status in zip(signals.connector_ids, signals.status, strict=True):
                light, link = ids.links[connector]
                letter = libsumo.trafficlight.getRedYellowGreenState(light)[link]
                assert {"g": 0, "y": 1, "r": 2}[letter.lower()] == status
                seen.add(SignalStatus(int(status)))
            traffic.place_ego(ego)
            traffic.advance()
    assert {SignalStatus.GREEN, SignalStatus.YELLOW, SignalStatus.RED} <= seen


def test_imposed_signals_hold_are_seen_and_leave_the_other_lights_alone() -> None:
    ids = NetworkIds.read(find_map(LTD.map).ids)
    lights = sorted({light for light, _ in ids.links.values()})
    mine = [connector for connector, (light, _) in ids.links.items() if light == lights[0]]
    wanted = {c: SignalStatus.RED if i % 2 else SignalStatus.GREEN for i, c in enumerate(sorted(mine))}
    ego = setup.start_state(LTD, load_roads(LTD.map))
    with setup.open_sumo_traffic(LTD, load_roads(LTD.map)) as traffic:
        traffic.impose_signals(wanted)
        others: set[int] = set()
        for _ in range(300):
            signals = traffic.observe().signals
            status = dict(zip(signals.connector_ids, signals.status, strict=True))
            assert all(status[connector] == imposed for connector, imposed in wanted.items())
            others |= {int(status[c]) for c in status if c not in wanted}
            traffic.place_ego(ego)
            traffic.advance()
        assert others >= {SignalStatus.GREEN, SignalStatus.YELLOW, SignalStatus.RED}
        with pytest.raises(TrafficError, match="no traffic light controls connector 'x'"):
            traffic.impose_signals({"x": SignalStatus.RED})


@pytest.mark.parametrize("scenario", few([LTD, HTD], 1), ids=lambda s: s.id)
def test_equal_drives_are_equal_and_other_seeds_are_other_drives(scenario: Scenario) -> None:
    short = replace(scenario, duration_s=12.0)
    hashes = [drive(short, IdmPlanner(), seed=seed).trace.hash() for seed in (0, 0, 1)]  # type: ignore[union-attr]
    assert hashes[0] == hashes[1] != hashes[2]


Snapshot = dict[str, tuple[float, float, float, float, str]]


def snapshot() -> tuple[Snapshot, list[str]]:
    """SUMO's own words on every vehicle (x, y, angle, speed, lane) and every light."""
    of, lights = libsumo.vehicle, libsumo.trafficlight
    vehicles = {
        name: (*of.getPosition(name), of.getAngle(name), of.getSpeed(name), of.getLaneID(name))
        for name in of.getIDList()
    }
    return vehicles, [lights.getRedYellowGreenState(light) for light in lights.getIDList()]


@pytest.mark.parametrize("name", DISTRICTS)
def test_without_an_ego_a_district_equals_plain_sumo_to_the_bit(name: str) -> None:
    roads = load_roads(name)
    scenario = random_scenario(name, np.random.default_rng(11), 11)
    scenario = replace(scenario, traffic=TrafficDemand("high", "mixed", "high"))
    ego = setup.start_state(scenario, roads)
    ours: list[tuple[Snapshot, list[str]]] = []
    of = libsumo.vehicle
    with setup.open_traffic(scenario, roads, presence=EgoPresence.ABSENT, most_agents=1000) as traffic:
        agents = {
            each: (of.getTypeID(each), of.getRoute(each), of.getLaneIndex(each), of.getLanePosition(each),
                   of.getSpeed(each))
            for each in of.getIDList()
        }  # fmt: skip
        phases = {light: libsumo.trafficlight.getPhase(light) for light in libsumo.trafficlight.getIDList()}
        for _ in range(STEPS):
            ours.append(snapshot())
            traffic.react(ego)
            traffic.place_ego(ego)
            traffic.advance()
    network, types = find_map(name).network, vehicle_type_file("mixed")
    libsumo.start(
        ["sumo", "-n", str(network), "-a", str(types), "--step-length", "0.1", "--insertion-checks", "none",
         "--lanechange.duration", "3", "--default.speeddev", "0", "--collision.action", "none",
         "--time-to-teleport", "-1", "--no-step-log", "true", "--no-warnings", "true"]
    )  # fmt: skip
    try:
        for each in sorted(agents, key=lambda each: int(each[1:])):
            kind, route, lane, position_m, speed_mps = agents[each]
            libsumo.route.add(each, route)
            start = {"departPos": f"{position_m:.6f}", "departSpeed": f"{speed_mps:.6f}"}
            of.add(each, each, kind, departLane=str(lane), **start)
        for light, phase in phases.items():
            if libsumo.trafficlight.getPhase(light) != phase:
                libsumo.trafficlight.setPhase(light, phase)
        plain: list[tuple[Snapshot, list[str]]] = []
        for step in range(STEPS):
            libsumo.simulationStep()
            for each in agents.keys() & of.getIDList() if step in (0, NEW_STEPS) else ():
                of.setLaneChangeMode(each, LANE_CHANGE_DEFAULT if step else NO_LANE_CHANGE)
            plain.append(snapshot())
    finally:
        libsumo.close()
    assert len(agents) > 15
    assert len({tuple(lights) for _, lights in ours}) > 1
    assert sum(vehicle[3] > 1.0 for vehicle in ours[100][0].values()) > 5
    assert ours == plain


@pytest.mark.parametrize("scenario", few([LTD, HTD], 1), ids=lambda s: s.id)
def test_a_drive_through_traffic_shows_no_overlap_and_a_gentle_first_step(scenario: Scenario) -> None:
    episode = drive(scenario, IdmPlanner())
    assert episode.fault is None
    trace = episode.trace
    assert trace is not None
    assert [pair for k in range(0, len(trace), 5) for pair in overlapping(trace.actors.at(k))] == []
    before, after = trace.actors.at(0), trace.actors.at(1)
    assert before.ids == after.ids
    assert (before.speed_mps - after.speed_mps).max() / 0.1 < 3.0
    assert set(trace.actors.behaviour) <= {"conservative", "assertive"}


def test_denser_traffic_is_denser() -> None:
    counts: list[int] = []
    for density in ("none", "low", "medium", "high"):
        with setup.open_traffic(replace(LTD, traffic=TrafficDemand(density)), load_roads(LTD.map)) as traffic:
            counts.append(len(traffic.observe().actors))
    assert counts[0] == 0
    assert counts[1] < counts[2] < counts[3]


BLOCKED = replace(
    HTD,
    id="test/blocked",
    obstacles=(Obstacle(LanePosition("402031", 150.0), turned_rad=0.6), Obstacle(LanePosition("402032", 215.0, -1.6))),
)


@pytest.mark.slow
def test_background_cars_pass_an_obstacle_and_never_touch_it() -> None:
    episode = drive(BLOCKED, IdmPlanner())
    assert episode.fault is None
    trace = episode.trace
    assert trace is not None
    standing = {name for name, kind in zip(trace.actors.ids, trace.actors.behaviour, strict=True) if kind == ""}
    assert len(standing) == 2
    for frame in range(0, len(trace), 2):
        assert [pair for *pair, _ in overlapping(trace.actors.at(frame)) if standing & set(pair)] == []


CROSSED = replace(
    LTD,
    id="test/crossed",
    traffic=TrafficDemand("none"),
    jaywalkers=(Jaywalker(LanePosition("402032", 150.0, -6.0), LanePosition("402032", 150.0, 9.0), 1.5),),
)


def test_a_jaywalker_waits_walks_with_its_true_velocity_and_stands_again() -> None:
    episode = drive(CROSSED, StraightAhead())
    trace = episode.trace
    assert trace is not None
    speed = np.array([trace.actors.at(k).speed_mps[0] for k in range(len(trace))])
    assert trace.actors.at(0).kind[0] == ActorKind.PEDESTRIAN
    walking = np.flatnonzero(speed > 0.0)
    assert speed[walking] == pytest.approx(1.5)
    places = np.array([[trace.actors.at(k).x_m[0], trace.actors.at(k).y_m[0]] for k in range(len(trace))])
    moved = np.hypot(*np.diff(places, axis=0).T)
    assert moved[walking[:-1]] == pytest.approx(0.15, abs=1e-6)
    # The walk begins when the front bumper is 4 s of driving, 48 m, before the crossing.
    noticed = trace.ego.state(int(walking[0]) - 1)
    arc_m, _ = load_roads(LTD.map)["402032"].centerline.project_point(noticed.x_m, noticed.y_m)
    assert 48.0 - 1.2 <= 150.0 - (arc_m + trace.shape.length_m / 2) <= 48.0


@pytest.mark.slow
def test_background_cars_stop_for_a_jaywalker() -> None:
    scenario = replace(CROSSED, id="test/crowd", traffic=TrafficDemand("high", "conservative"))
    episode = drive(scenario, IdmPlanner())
    trace = episode.trace
    assert trace is not None
    for frame in range(len(trace)):
        actors = trace.actors.at(frame)
        walker = int(np.flatnonzero(actors.kind == ActorKind.PEDESTRIAN)[0])
        cars = np.flatnonzero(actors.kind == ActorKind.VEHICLE)
        body = box_corners(*(getattr(actors, n)[walker] for n in ("x_m", "y_m", "heading_rad", "length_m", "width_m")))
        touching = penetration_m(actors.corners[cars], np.repeat(body, len(cars), axis=0)) > 0.0
        front_hits = touching & (actors.speed_mps[cars] > 0.5)
        assert not front_hits.any(), f"frame {frame}"


@pytest.mark.slow
def test_nobody_starts_on_a_pedestrian_who_waits_on_the_road() -> None:
    waits = (Jaywalker(LanePosition("402032", 150.0, 0.0), LanePosition("402032", 150.0, 9.0), 1.5),)
    scenario = replace(CROSSED, id="test/on_the_road", traffic=TrafficDemand("high"), jaywalkers=waits)
    for seed in range(8):
        with setup.open_traffic(scenario, load_roads(LTD.map), seed=seed) as traffic:
            actors = traffic.observe().actors
        walker = int(np.flatnonzero(actors.kind == ActorKind.PEDESTRIAN)[0])
        ahead_m = actors.x_m - actors.x_m[walker], actors.y_m - actors.y_m[walker]
        others = np.arange(len(actors)) != walker
        assert np.hypot(*ahead_m)[others].min() > 2.3


def test_a_truncated_network_is_one_clear_line_and_no_crash(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = Path(shutil.copytree(find_map(LTD.map).folder, tmp_path / "map"))
    monkeypatch.setattr(setup, "find_map", lambda name, _beside: MapFiles(name, "1.0", folder))
    path = folder / "map.net.xml.gz"
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 3])
    with pytest.raises(MapError, match=r"map\.net\.xml\.gz: .*damaged.*maps convert"):
        drive(LTD, StraightAhead())
