"""Kerbside: where cars may be parked and how a door opens, and which crosswalks people come to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from interplan_sumo.endurance.kerbside import (
    DOOR_EDGE_M,
    DOOR_M,
    LONGEST_CROSSWALK_M,
    ParkedCar,
    Thing,
    crosswalks_on,
    parked_car,
)
from interplan_sumo.endurance.opportunities import WALKER_M
from interplan_sumo.endurance.staged import (
    DOOR_S,
    EGO_BRAKES_MPS2,
    EGO_REACTS_S,
    GIVES_UP_S,
    OPEN_S,
    OpeningDoor,
    others_can_stop,
    surprises,
)
from interplan_sumo.endurance.street_people import FORGOTTEN_M, StreetPeople
from interplan_sumo.endurance.trip_way import TripWay
from interplan_sumo.scenario.scenario import LanePosition, Scenario
from interplan_sumo.scenario.sites import edges_m
from interplan_sumo.simulation.agent_registry import AgentSnapshot
from interplan_sumo.tiny_worlds import junction, straight_road
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.ego import PACIFICA, EgoState
from interplan_sumo.world.geometry import Pose
from interplan_sumo.world.roads import Area, Roads

ROAD = straight_road(lanes=2)
"""Along the x axis; its right lane's middle is at y = -3.5, its edges at y = 1.75 and y = -5.25."""
OUTER, INNER = "12", "11"


def way_on(roads: Roads, lanes: tuple[str, ...]) -> TripWay:
    scenario = Scenario(
        id="endure/0", family="endure", map=roads.name, start=LanePosition(lanes[0], 5.0), start_speed_mps=0.0,
        goal=LanePosition(lanes[-1], roads[lanes[-1]].centerline.length_m - 3.0),
        route=tuple(roads[lane].roadblock_id for lane in lanes), duration_s=60.0,
    )  # fmt: skip
    return TripWay(scenario, roads)


def parked(lane: str, roads: Roads = ROAD, at_m: float = 100.0) -> ParkedCar | None:
    way = way_on(roads, (lane,))
    return parked_car(way, LanePosition(lane, at_m), at_m, edges_m(roads, roads.lanes[lane], at_m))


def test_a_car_stands_beside_the_road_and_its_open_door_reaches_into_the_lane() -> None:
    found = parked(OUTER)
    assert found is not None
    car, door = found.things("a", "b")
    assert (car.kind, door.kind) == (ActorKind.VEHICLE, ActorKind.GENERIC_OBJECT)
    assert car.corners((0.0, 0.0))[:, 1].max() == pytest.approx(-5.35)
    y_m = door.corners((0.0, 0.0))[:, 1]
    assert y_m.max() == pytest.approx(-5.35 + DOOR_M, abs=0.05)
    assert y_m.min() == pytest.approx(-5.35, abs=0.05)
    assert found.conflict_m == pytest.approx(float(door.corners((0.0, 0.0))[:, 0].mean()))
    assert shapely.Polygon(car.corners((0.0, 0.0))).distance(shapely.Polygon(door.corners((0.0, 0.0)))) < 0.1


def test_on_the_left_the_door_opens_to_the_right() -> None:
    found, outer = parked(INNER), parked(OUTER)
    assert found is not None
    assert outer is not None
    car, door = found.things("a", "b")
    assert car.corners((0.0, 0.0))[:, 1].min() == pytest.approx(1.85)
    assert door.corners((0.0, 0.0))[:, 1].min() == pytest.approx(1.85 - DOOR_M, abs=0.05)
    assert door.pose.x_m == pytest.approx(outer.door.x_m)


@pytest.mark.parametrize(("edge_m", "fits"), [(DOOR_EDGE_M[0], True), (DOOR_EDGE_M[1] + 0.01, False), (1.39, False)])
def test_a_car_is_parked_only_where_its_door_concerns_the_ego_and_leaves_it_room(edge_m: float, fits: bool) -> None:
    way, place = way_on(ROAD, (OUTER,)), LanePosition(OUTER, 100.0)
    beside = replace(ROAD, road_segments=(Area("1", shapely.box(0.0, -3.5 - edge_m, 200.0, 1.75)),), intersections=())
    assert (parked_car(replace(way, roads=beside), place, 100.0, (5.25, edge_m)) is not None) is fits


def test_no_car_is_parked_where_others_drive() -> None:
    lot = replace(ROAD, carparks=(Area("lot", shapely.box(95.0, -8.0, 105.0, -5.6)),))
    assert parked(OUTER, lot) is None
    assert parked(OUTER, lot, at_m=60.0) is not None


def nobody(*others: tuple[float, float, float, float]) -> AgentSnapshot:
    """Agents by front, heading and speed."""
    table = np.array(others, dtype=np.float64).reshape(-1, 4).T
    names = [f"a{n}" for n in range(len(others))]
    x, y, heading, speed = table
    return AgentSnapshot(
        names, {name: row for row, name in enumerate(names)}, x, y, heading, speed, {}, frozenset(), list,
        lambda _: [], lambda _: (),
    )  # fmt: skip


def opening() -> tuple[StreetPeople, OpeningDoor, ParkedCar]:
    people, found = StreetPeople(0.1), parked(OUTER)
    assert found is not None
    act = OpeningDoor(
        people, found.things("a", "b"), found.conflict_m, way_on(ROAD, (OUTER,)).line, PACIFICA, (0.0, 0.0)
    )
    people.advance()
    return people, act, found


def seen(people: StreetPeople) -> list[str]:
    people.advance()
    return list(people.observe().ids)


def test_a_door_opens_three_seconds_before_the_ego_and_closes_again() -> None:
    people, act, found = opening()
    front_m = PACIFICA.length_m / 2.0
    too_far_m = found.conflict_m - front_m - DOOR_S * 10.0 - 0.2
    act.step(nobody(), EgoState(0.0, too_far_m, -3.5, 0.0, 10.0))
    assert seen(people) == ["a"]
    assert set(people.standing((0.0, 0.0))) == {"a"}
    act.step(nobody(), EgoState(0.0, too_far_m + 0.3, -3.5, 0.0, 10.0))
    assert seen(people) == ["a", "b"]
    assert set(people.standing((0.0, 0.0))) == {"a", "b"}
    waits = EgoState(0.0, found.conflict_m - 10.0, -3.5, 0.0, 0.0)
    for _ in range(round(OPEN_S / 0.1)):
        assert not act.is_over
        act.step(nobody(), waits)
    act.step(nobody(), waits)
    assert act.is_over
    assert seen(people) == ["a"]
    people.notice(replace(waits, x_m=found.car.x_m + FORGOTTEN_M + 1.0), PACIFICA)
    assert seen(people) == []


def test_a_door_stays_shut_before_others_who_could_not_stop_and_behind_the_ego() -> None:
    people, act, found = opening()
    near = EgoState(0.0, found.conflict_m - 10.0, -3.5, 0.0, 5.0)
    another = (found.conflict_m - 12.0, -3.5, 0.0, 10.0)
    act.step(nobody(another), near)
    assert seen(people) == ["a"]
    act.step(nobody(), replace(near, x_m=found.conflict_m + 20.0))
    assert act.is_over
    assert seen(people) == ["a"]
    people, act, found = opening()
    for _ in range(round(GIVES_UP_S / 0.1) + 1):
        act.step(
            nobody(), replace(near, x_m=0.0, vx_mps=0.0) if hasattr(near, "vx_mps") else EgoState(0.0, 0.0, -3.5, 0.0)
        )
    assert act.is_over


STOPS_M = 10.0**2 / (2.0 * EGO_BRAKES_MPS2) + 10.0 * EGO_REACTS_S


@pytest.mark.parametrize(("ahead_m", "opens"), [(STOPS_M + 0.1, True), (STOPS_M - 0.1, False), (0.5, False)])
def test_a_door_opens_late_only_while_the_ego_can_stop(ahead_m: float, opens: bool) -> None:
    """Somebody beside it could not stop until now."""
    people, act, found = opening()
    ego = EgoState(0.0, found.conflict_m - PACIFICA.length_m / 2.0 - ahead_m, -3.5, 0.0, 10.0)
    act.step(nobody((found.conflict_m - 12.0, 0.0, 0.0, 10.0)), ego)
    assert seen(people) == ["a"]
    act.step(nobody(), ego)
    assert seen(people) == (["a", "b"] if opens else ["a"])


@given(ahead_m=st.floats(0.0, 80.0), mps=st.floats(0.0, 25.0))
def test_what_surprises_a_slow_ego_or_one_that_is_farther_away_can_be_stopped_for(ahead_m: float, mps: float) -> None:
    here = surprises(ahead_m, mps, 200.0, nobody(), (0.0, 0.0))
    assert here == (ahead_m >= mps * EGO_REACTS_S + mps**2 / (2.0 * EGO_BRAKES_MPS2))
    assert surprises(ahead_m + 1.0, mps, 200.0, nobody(), (0.0, 0.0)) >= here
    assert not surprises(ahead_m, mps, ahead_m - 0.1, nobody(), (0.0, 0.0))


@pytest.mark.parametrize(("ahead_m", "can"), [(10.0**2 / 6.0 + 12.1, True), (10.0**2 / 6.0 + 11.9, False)])
def test_others_can_stop_from_as_far_as_they_brake_with_3_mps2(ahead_m: float, can: bool) -> None:
    assert others_can_stop(nobody((0.0, 0.0, 0.0, 10.0)), (ahead_m, 0.0)) is can
    assert others_can_stop(nobody((0.0, 0.0, np.pi, 10.0)), (ahead_m, 0.0))


def with_crosswalk(roads: Roads, polygon: shapely.Polygon) -> Roads:
    return replace(roads, crosswalks=(Area("zebra", polygon),))


def test_people_cross_on_a_crosswalk_from_kerb_to_kerb() -> None:
    roads = with_crosswalk(ROAD, shapely.box(120.0, -5.5, 124.0, 2.0))
    (found,) = crosswalks_on(way_on(roads, (OUTER,)))
    assert found.conflict_m == pytest.approx(122.0)
    assert found.walk.points[:, 0] == pytest.approx([122.0, 122.0])
    assert found.walk.points[:, 1] == pytest.approx([-6.2, 2.7])  # from the side that is nearer to the ego's lane
    assert found.walk.duration_s == pytest.approx(8.9 / 1.4)


@pytest.mark.parametrize(
    "polygon",
    [
        shapely.box(120.0, -4.0, 124.0, 2.0),  # ends on the road
        shapely.box(80.0, -5.5, 124.0, 2.0),  # lies along the road
        shapely.box(120.0, -5.5, 124.0, LONGEST_CROSSWALK_M),
        shapely.box(120.0, 3.0, 124.0, 9.0),  # beside it
    ],
)
def test_what_does_not_lead_across_is_no_crosswalk(polygon: shapely.Polygon) -> None:
    assert crosswalks_on(way_on(with_crosswalk(ROAD, polygon), (OUTER,))) == []


@pytest.mark.parametrize("lit", [True, False])
def test_nobody_crosses_against_a_light(lit: bool) -> None:
    """Lane 1 comes from the west, y = -1.75, up to x = -12, connector 13 leads on."""
    roads = junction()
    connectors = {name: each if lit else replace(each, stop_line_ids=()) for name, each in roads.connectors.items()}
    assert roads.connectors["13"].has_traffic_light
    dark = replace(roads, connectors=connectors, stop_lines=roads.stop_lines if lit else {})
    way = way_on(with_crosswalk(dark, shapely.box(-18.0, -3.8, -14.0, 3.8)), ("1", "13", "7"))
    assert (crosswalks_on(way) == []) is lit


def test_what_stands_is_an_actor_among_those_on_foot() -> None:
    people = StreetPeople(0.1)
    people.put(Thing("k", ActorKind.VEHICLE, Pose(1.0, 2.0, 0.5), (4.6, 1.85)))
    assert people.advance()
    assert not people.advance()
    actors = people.observe()
    assert (actors.x_m[0], actors.y_m[0], actors.heading_rad[0], actors.length_m[0]) == (1.0, 2.0, 0.5, 4.6)
    assert actors.vx_mps[0] == 0.0


def test_opportunities_begin_out_of_sight() -> None:
    assert 100.0 + PACIFICA.length_m < WALKER_M
