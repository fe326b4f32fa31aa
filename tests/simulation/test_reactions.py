"""Who reacts to the ego, from which overlap on, and how: pure decisions, no SUMO."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from networks import LANE_Y, two_way_road

from interplan_sumo.simulation import ego_locator, reactions
from interplan_sumo.simulation.idm import acceleration_mps2
from interplan_sumo.simulation.lane_chains import corridor
from interplan_sumo.simulation.lane_polygons import ClipArea, Ring
from interplan_sumo.simulation.network import NetworkLane, NetworkLink, SumoNetwork
from interplan_sumo.simulation.reactions import (
    COMING,
    Agent,
    DriverModels,
    EgoOnNetwork,
    LaneCoverage,
    Mode,
    ReactionDecision,
    ReactionMemory,
)
from interplan_sumo.simulation.vehicle_types import VehicleType
from interplan_sumo.world.ego import PACIFICA, EgoState
from interplan_sumo.world.geometry import Polyline

NETWORK = two_way_road()
EASTWARD = ("e0", "e1")
BOUNDARY_Y = -7.0  # between lanes 0 and 1


def driver(overlap: float, **rest: Any) -> VehicleType:
    size: dict[str, Any] = {"length_m": 4.6, "width_m": 1.85}
    return VehicleType(
        "d", tau_s=1.5, min_gap_m=1.0, accel_mps2=1.0, decel_mps2=2.0, react_overlap=overlap, **size | rest
    )


def follower(
    overlap: float, lane: str = "e0_1", position_m: float = 60.0, *, ego_behind: bool = False, **rest: float
) -> Agent:
    ahead = corridor(NETWORK, lane, EASTWARD)
    return Agent("a", driver(overlap, **rest), position_m, 10.0, ahead, ego_behind)


def idm_mps(_name: str, speed_mps: float, gap_m: float, leader_mps: float, _leader: str) -> float:
    return speed_mps + 0.1 * acceleration_mps2(driver(0.0), speed_mps, 15.0, gap_m, leader_mps)


def drivers(chance: float = 0.5, cut_in: Callable[[str, float, float], None] = lambda *_: None) -> DriverModels:
    return DriverModels(idm_mps, lambda _name: chance, cut_in, 0.1)


def ring(ego: EgoState) -> Ring:
    return [(x, y) for x, y in ego.corners(PACIFICA).tolist()]


def cover(ring: Ring, velocity_mps: tuple[float, float]) -> dict[str, LaneCoverage]:
    area = ClipArea.of(ring)
    return ego_locator.lane_coverage(NETWORK.pieces_near(area), area, velocity_mps)


def seen(y_m: float, anchor: str, speed_mps: float = 8.0, x_m: float = 100.0, heading_rad: float = 0.0) -> EgoOnNetwork:
    ego = EgoState(0.0, x_m, y_m, heading_rad, vx_mps=speed_mps)
    coverage = cover(ring(ego), (speed_mps, 0.0))
    centre = frozenset(piece.lane.id for piece in NETWORK.pieces[0] if piece.holds(x_m, y_m))
    return EgoOnNetwork(coverage, centre, anchor, x_m + 2.6, speed_mps, True)


def decision(
    agent: Agent, ego: EgoOnNetwork, memory: dict[str, ReactionMemory] | None = None, **rest: bool
) -> ReactionDecision:
    decided = reactions.decide([agent], ego, {}, {} if memory is None else memory, drivers(), **rest)
    return decided.get("a", ReactionDecision(Mode.SUMO, 0.0, False))


def at_overlap(share: float) -> float:
    """The y of an ego from lane 0 of whose width this share lies in lane 1."""
    return BOUNDARY_Y - PACIFICA.width_m / 2 + share * PACIFICA.width_m


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_the_overlap_is_the_share_of_the_box_inside_the_lane(share: float) -> None:
    coverage = seen(at_overlap(share), "e0_0").coverage
    assert coverage["e0_1"].share == pytest.approx(share)
    assert coverage["e0_0"].share == pytest.approx(1 - share)
    assert coverage["e0_1"].start_m == pytest.approx(100.0 - PACIFICA.length_m / 2)


@pytest.mark.parametrize("threshold", [0.25, 0.5, 0.75])
def test_an_agent_reacts_from_its_threshold_on(threshold: float) -> None:
    below = decision(follower(threshold), seen(at_overlap(threshold - 0.01), "e0_0"))
    above = decision(follower(threshold), seen(at_overlap(threshold + 0.01), "e0_0"))
    assert (below.reacting, below.mode) == (False, Mode.SUMO)
    assert (above.reacting, above.mode) == (True, Mode.OVERRIDE_SPEED)


def test_a_conservative_agent_reacts_at_first_touch_and_not_before() -> None:
    assert not decision(follower(0.0), seen(at_overlap(-0.01), "e0_0")).reacting
    assert decision(follower(0.0), seen(at_overlap(0.01), "e0_0")).mode is Mode.OVERRIDE_SPEED


def test_an_assertive_agent_overlooks_an_ego_that_sumo_already_puts_in_its_lane() -> None:
    assert decision(follower(1.0), seen(at_overlap(0.9), "e0_1")).mode is Mode.IGNORE_EGO


def test_an_assertive_agent_follows_a_fully_merged_ego_as_sumo_does() -> None:
    merged = decision(follower(1.0), seen(LANE_Y[1], "e0_1"))
    assert (merged.reacting, merged.mode) == (True, Mode.SUMO)


def test_a_reaction_lasts_until_the_ego_has_left_the_lane() -> None:
    memory: dict[str, ReactionMemory] = {}
    assert decision(follower(1.0), seen(LANE_Y[1], "e0_1"), memory).reacting
    assert decision(follower(1.0), seen(at_overlap(0.05), "e0_0"), memory).reacting
    assert not decision(follower(1.0), seen(at_overlap(-0.05), "e0_0"), memory).reacting
    assert not decision(follower(1.0), seen(at_overlap(0.5), "e0_0"), memory).reacting


def test_an_ego_that_starts_in_the_lane_is_respected_from_the_first_step() -> None:
    straddling = seen(at_overlap(0.7), "e0_1")  # its centre is in lane 1
    assert not decision(follower(1.0), straddling).reacting
    assert decision(follower(1.0), straddling, at_start=True).reacting


def test_after_two_seconds_with_its_centre_in_the_lane_the_ego_is_the_leader() -> None:
    memory: dict[str, ReactionMemory] = {}
    reacting = [decision(follower(1.0), seen(at_overlap(0.7), "e0_1"), memory).reacting for _ in range(20)]
    assert reacting == [False] * 19 + [True]


def test_an_ego_behind_the_agent_concerns_nobody() -> None:
    assert decision(follower(0.0, position_m=150.0), seen(LANE_Y[1], "e0_1")).mode is Mode.SUMO


def test_an_oncoming_agent_is_slowed_for_an_ego_in_its_lane_by_the_closing_speed() -> None:
    westward = corridor(NETWORK, "w0_0", ("w0",))
    agent = Agent("a", driver(0.0), 220.0, 12.0, westward)  # 400 - 220 = x 180, coming towards x = 100
    against = decision(agent, seen(1.75, "e0_2"))
    assert against.mode is Mode.OVERRIDE_SPEED
    assert against.speed_mps is not None
    still = decision(agent, seen(1.75, "e0_2", speed_mps=0.0))
    assert still.speed_mps is not None
    assert against.speed_mps < still.speed_mps < 12.0


def test_an_imposed_speed_brakes_no_harder_than_the_emergency_deceleration() -> None:
    close = decision(follower(0.0, position_m=97.0), seen(at_overlap(0.5), "e0_0", speed_mps=0.0))
    assert close.speed_mps == pytest.approx(10.0 - 9.0 * 0.1)


def test_anticipation_looks_at_the_swept_box() -> None:
    ego = EgoState(0.0, 100.0, at_overlap(-0.5), 0.2, vx_mps=8.0)
    velocity = (7.84, 1.59)
    box = ring(ego)
    now = cover(box, velocity)
    soon = cover(ego_locator.swept_area(box, velocity, 2.0), velocity)
    assert "e0_1" not in now
    on_network = EgoOnNetwork(now, frozenset({"e0_0"}), "e0_0", 102.6, 8.0, True)
    for behind, mode in ((False, Mode.OVERRIDE_SPEED), (True, Mode.SUMO)):
        agent = follower(0.0, anticipation_s=2.0, ego_behind=behind)
        decided = reactions.decide([agent], on_network, {2.0: soon}, {}, drivers())
        assert decided.get("a", ReactionDecision(Mode.SUMO, 0.0, False)).mode is mode


def test_the_corridor_runs_on_through_junctions_along_the_route() -> None:
    ahead = corridor(NETWORK, "e0_1", EASTWARD)
    assert ahead == pytest.approx({"e0_1": 0.0, ":B_1_1": 400.0, "e1_1": 400.1})
    assert corridor(NETWORK, ":B_1_1", EASTWARD) == pytest.approx({":B_1_1": 0.0, "e1_1": 0.1})


@pytest.mark.parametrize(("choice", "taken"), [(("e0_0", "e1_1"), "e1_1"), (("e0_0", "e1_0"), "e1_0"), ((), "e1_0")])
def test_where_a_lane_leads_to_several_the_corridor_is_the_one_that_the_agent_means_to_take(
    choice: tuple[str, ...], taken: str
) -> None:
    ways = {**NETWORK.links, "e0_0": tuple(NetworkLink("e0_0", to, (), "s", True, None) for to in ("e1_0", "e1_1"))}
    forked = SumoNetwork(Path("none"), NETWORK.lanes, NETWORK.edges, ways)
    assert list(corridor(forked, "e0_0", EASTWARD, lambda: choice)) == ["e0_0", taken]


def test_the_corridor_reaches_150_m_beyond_the_own_lane() -> None:
    lines = [Polyline(np.array([[10.0 * i, 0.0], [10.0 * (i + 1), 0.0]])) for i in range(30)]
    lanes = [NetworkLane(f"e{i}_0", f"e{i}", 0, line, 10.0, 3.5, 13.9, internal=False) for i, line in enumerate(lines)]
    links = {a.id: (NetworkLink(a.id, b.id, (), "s", True, None),) for a, b in pairwise(lanes)}
    road = SumoNetwork(Path("none"), {each.id: each for each in lanes}, {}, {**links, "e29_0": ()})
    ahead = corridor(road, "e0_0", tuple(each.edge for each in lanes))
    assert max(ahead.values()) == 150.0  # the lane that begins at 160 m is no longer ahead


def ahead_at(speed_mps: float, position_m: float = 100.0) -> EgoOnNetwork:
    """An ego at 10 m/s wholly in lane 1, which it drives along at another speed."""
    covered = LaneCoverage(1.0, position_m - PACIFICA.length_m, position_m, speed_mps)
    return EgoOnNetwork({"e0_1": covered}, frozenset({"e0_1"}), "e0_1", position_m, 10.0, straddles=False)


@pytest.mark.parametrize(
    ("share", "mode"), [(0.86, Mode.SUMO), (0.84, Mode.OVERRIDE_SPEED), (-1.0, Mode.OVERRIDE_SPEED)]
)
def test_sumo_follows_an_ego_that_drives_along_the_lane_and_not_one_that_crosses_it(share: float, mode: Mode) -> None:
    assert decision(follower(0.0), ahead_at(10.0 * share)).mode is mode


def test_sumo_is_not_left_to_follow_an_ego_that_it_may_have_behind_the_agent() -> None:
    passed = ahead_at(10.0)._replace(out_of_order=True)
    assert decision(follower(0.0), passed).mode is Mode.OVERRIDE_SPEED


@pytest.mark.parametrize(("front_m", "mode"), [(55.5, Mode.IGNORE_EGO), (55.3, Mode.SUMO)])
def test_sumo_overlooks_an_ego_beside_the_agent_and_one_wholly_behind_it_needs_no_word(
    front_m: float, mode: Mode
) -> None:
    """The agent's rear is at 55.4 m, its front at 60 m; for SUMO, the ego is a car in its lane."""
    beside = EgoOnNetwork({}, frozenset(), "e0_1", front_m, 8.0, straddles=True)
    assert decision(follower(0.0), beside).mode is mode


@pytest.mark.parametrize(("standing_gap_m", "speed_mps"), [(60.0, 9.980), (45.0, 9.950)])
def test_of_two_cars_ahead_the_one_counts_for_which_idm_brakes_harder(standing_gap_m: float, speed_mps: float) -> None:
    """At 10 m/s it wishes 16 m to a car as fast as itself, which is there, and 51.4 m to one that stands."""
    agent = follower(0.0)
    fast = ("b", LaneCoverage(0.0, 60.0 + 16.0, 80.0, 10.0))
    standing = ("c", LaneCoverage(0.0, 60.0 + standing_gap_m, 125.0, 0.0))
    told = reactions.yield_to([agent], {"e0_1": [fast, standing]}, {}, drivers())["a"]
    assert told.speed_mps == pytest.approx(speed_mps, abs=2e-3)


def test_a_model_is_asked_about_the_nearest_first_for_some_remember_what_they_were_asked() -> None:
    """Else the drive would hang on the order of a set, which is another one in every process."""
    asked: list[str] = []

    def follow(name: str, speed_mps: float, gap_m: float, leader_mps: float, leader: str) -> float:
        asked.append(leader)
        return idm_mps(name, speed_mps, gap_m, leader_mps, leader)

    ahead = [(name, LaneCoverage(0.0, 70.0 + 10.0 * i, 75.0 + 10.0 * i, 0.0)) for i, name in enumerate("hgfedcb")]
    reactions.yield_to([follower(0.0)], {"e0_1": ahead[::-1]}, {}, replace(drivers(), follow=follow))
    assert asked == [*"hgfedcb", ""]


@pytest.mark.parametrize(("gap_m", "told"), [(400.0, False), (60.0, True)])
def test_who_hardly_minds_what_is_ahead_is_told_nothing(gap_m: float, told: bool) -> None:
    """A speed that is told is one to drive at: it would overrule a light that SUMO brakes for."""
    far = ("b", LaneCoverage(0.0, 60.0 + gap_m, 65.0 + gap_m, 0.0))
    assert bool(reactions.yield_to([follower(0.0)], {"e0_1": [far]}, {}, drivers())) is told


@pytest.mark.parametrize(
    ("name", "gap_m", "speed_mps", "brakes"),
    [("", 4.0, 10.0, True), (COMING, 4.0, 10.0, False), (COMING, 7.0, 10.0, True), (COMING, -2.0, 0.0, True)],
)
def test_who_can_no_longer_stop_before_somebody_that_is_only_coming_drives_on(
    name: str, gap_m: float, speed_mps: float, brakes: bool
) -> None:
    """From 10 m/s it takes 6.6 m to stop at 9 m/s2; who stands waits for those beside it."""
    agent = follower(0.0)._replace(speed_mps=speed_mps)
    way = (name, LaneCoverage(0.0, 60.0 + gap_m, 61.0 + gap_m, 0.0))
    assert bool(reactions.yield_to([agent], {"e0_1": [way]}, {}, drivers())) is brakes


@pytest.mark.parametrize(("speed_mps", "waits"), [(0.4, True), (0.6, False)])
def test_who_stands_waits_for_a_pedestrian_beside_it_and_who_drives_goes_on(speed_mps: float, waits: bool) -> None:
    agent = follower(1.0)._replace(speed_mps=speed_mps)
    crossing = LaneCoverage(0.0, 58.0, 59.0, 0.0)
    told = reactions.yield_to([agent], {"e0_1": [("", crossing)]}, {}, drivers())
    assert [each.speed_mps for each in told.values()] == ([0.0] if waits else [])
    assert reactions.yield_to([agent], {"e0_1": [("b", crossing)]}, {}, drivers()) == {}


@pytest.mark.parametrize(("gap_m", "speed_mps"), [(0.45, 0.0), (0.55, 0.1)])
def test_nobody_closes_up_below_half_a_metre_even_if_its_model_pulls_away(gap_m: float, speed_mps: float) -> None:
    pulls_away = DriverModels(lambda *_: 0.4, lambda _: 0.5, lambda *_: None, 0.1)
    agent = follower(1.0)._replace(speed_mps=0.0)
    assert pulls_away.next_speed_mps(agent, gap_m, 0.0) == pytest.approx(speed_mps)


@pytest.mark.parametrize(("position_m", "reacts"), [(97.3, True), (97.5, False)])
def test_only_what_begins_ahead_of_the_front_bumper_concerns_an_agent(position_m: float, reacts: bool) -> None:
    """The rear of the ego is at 97.4 m."""
    assert decision(follower(0.0, position_m=position_m), seen(at_overlap(0.5), "e0_0")).reacting is reacts


def test_a_car_ahead_does_not_brake_for_a_swept_box_that_begins_behind_it() -> None:
    """Neither on its own lane nor on those that follow, which the box reaches ahead of it."""
    behind = LaneCoverage(0.7, 380.0, 400.0, 12.0)
    beyond = LaneCoverage(0.3, 0.0, 20.0, 12.0)
    swept = {"e0_1": behind, "e1_1": beyond}
    on_network = EgoOnNetwork(
        {"e0_1": LaneCoverage(1.0, 380.0, 385.2, 12.0)}, frozenset({"e0_1"}), "e0_1", 385.2, 12.0, False
    )
    agent = follower(0.0, position_m=398.0, anticipation_s=3.0)
    assert not reactions.decide([agent], on_network, {3.0: swept}, {}, drivers())["a"].reacting


def test_whoever_has_stopped_for_the_ego_stands_while_it_backs_into_the_front_bumper() -> None:
    memory = {"a": ReactionMemory(reacting=True)}
    touched = decision(follower(0.0, position_m=97.5), seen(LANE_Y[1], "e0_1", speed_mps=-1.0), memory)
    assert (touched.mode, touched.speed_mps) == (Mode.OVERRIDE_SPEED, pytest.approx(10.0 - 0.9))


@pytest.mark.parametrize("reaction_s", [0.0, 0.3, 1.0])
def test_the_first_response_comes_a_reaction_time_after_the_condition(reaction_s: float) -> None:
    memory: dict[str, ReactionMemory] = {}
    agent = follower(0.5, reaction_time_s=reaction_s)
    assert not decision(agent, seen(at_overlap(0.4), "e0_0"), memory).reacting
    reacting = [decision(agent, seen(at_overlap(0.6), "e0_0"), memory).reacting for _ in range(15)]
    assert reacting.index(True) == round(reaction_s / 0.1)
    assert all(reacting[reacting.index(True) :])


def test_a_condition_that_passes_within_the_reaction_time_was_none() -> None:
    memory: dict[str, ReactionMemory] = {}
    agent = follower(0.5, reaction_time_s=0.3)
    overlaps = (0.6, 0.6, 0.4, 0.6, 0.6, 0.6)
    assert not any(decision(agent, seen(at_overlap(each), "e0_0"), memory).reacting for each in overlaps)


def approaching(
    agent: Agent, chance: float, memory: dict[str, ReactionMemory] | None = None, **ego_is: Any
) -> ReactionDecision:
    """What an agent on lane 1 does about an ego on lane 0 that moves towards it, from 97.4 to 102.6 m, at 8 m/s."""
    beside = {"e0_1": LaneCoverage(0.0, 97.4, 102.6, 8.0)}
    ego = seen(LANE_Y[0], "e0_0")._replace(approached=beside, **ego_is)
    decided = reactions.decide([agent], ego, {}, {} if memory is None else memory, drivers(chance))
    return decided.get("a", ReactionDecision(Mode.SUMO, 0.0, False))


@pytest.mark.parametrize(("chance", "yields"), [(0.69, True), (0.71, False)])
def test_courtesy_is_the_chance_to_open_a_gap_before_the_boxes_overlap(chance: float, yields: bool) -> None:
    agent = follower(1.0, position_m=85.0, courtesy=0.7)
    told = approaching(agent, chance)
    assert told.reacting is yields
    assert (told.speed_mps is not None) is yields


@pytest.mark.parametrize(("position_m", "speed_mps"), [(90.0, 10.0 - 0.2), (96.4, 10.0 - 0.4), (97.5, None)])
def test_a_courteous_agent_brakes_no_harder_than_is_comfortable_or_needed_and_never_for_an_ego_beside_it(
    position_m: float, speed_mps: float | None
) -> None:
    told = approaching(follower(1.0, position_m=position_m, courtesy=1.0), 0.0)
    assert told.speed_mps == (None if speed_mps is None else pytest.approx(speed_mps))


def test_who_gives_way_goes_on_once_the_ego_is_in_the_lane() -> None:
    memory: dict[str, ReactionMemory] = {}
    agent = follower(1.0, courtesy=1.0)
    assert approaching(agent, 0.0, memory).reacting
    assert decision(agent, seen(at_overlap(0.9), "e0_1"), memory).speed_mps is not None
    assert decision(agent, seen(at_overlap(1.0), "e0_1"), memory) == ReactionDecision(Mode.SUMO, 1.0, True)


def test_who_gives_way_keeps_behind_the_rear_of_an_ego_of_which_only_the_front_is_in_the_lane() -> None:
    corner = {"e0_1": LaneCoverage(0.1, 101.0, 102.6, 8.0)}
    agent = follower(1.0, position_m=96.4, courtesy=1.0)
    memory: dict[str, ReactionMemory] = {}
    before = approaching(agent, 0.0, memory)
    assert approaching(agent, 0.0, memory, coverage=corner) == before._replace(overlap=0.1)


def test_who_gives_way_to_an_ego_that_brakes_brakes_that_much_harder() -> None:
    agent = follower(1.0, position_m=96.4, courtesy=1.0)
    assert approaching(agent, 0.0, braking_mps2=3.0).speed_mps == pytest.approx(10.0 - 0.7)


@pytest.mark.parametrize(("courtesy", "mode"), [(1.0, Mode.IGNORE_EGO), (0.0, Mode.SUMO)])
def test_in_a_junction_sumo_does_not_brake_for_an_ego_to_which_somebody_is_about_to_give_way(
    courtesy: float, mode: Mode
) -> None:
    agent = follower(1.0, position_m=85.0, courtesy=courtesy, reaction_time_s=0.8)
    assert approaching(agent, 0.5, in_junction=True).mode is mode


@pytest.mark.parametrize(("apart_s", "anew"), [(2.9, False), (3.0, True)])
def test_chance_decides_once_per_encounter(apart_s: float, anew: bool) -> None:
    memory: dict[str, ReactionMemory] = {}
    agent = follower(1.0, courtesy=0.5)
    assert approaching(agent, 0.4, memory).reacting
    for _ in range(round(apart_s / 0.1)):
        decision(agent, seen(LANE_Y[0], "e0_0"), memory)
    assert approaching(agent, 0.6, memory).reacting is not anew


def test_an_ego_that_comes_into_the_lane_is_reported_as_cutting_in_once() -> None:
    told: list[tuple[str | float, ...]] = []
    memory: dict[str, ReactionMemory] = {}
    for _ in range(2):
        ego = seen(at_overlap(0.5), "e0_0")
        reactions.decide([follower(0.0)], ego, {}, memory, drivers(cut_in=lambda *said: told.append(said)))
    assert told == [("a", pytest.approx(100.0 - PACIFICA.length_m / 2.0 - 60.0 - 1.0), 10.0)]


def test_one_that_sumo_overlooks_stays_overlooked_on_the_lane_on_which_the_agent_passed_through_it() -> None:
    """SUMO keeps the order of the cars on a lane."""
    memory: dict[str, ReactionMemory] = {}
    assert decision(follower(1.0, position_m=60.0), seen(at_overlap(0.5), "e0_1"), memory).mode is Mode.IGNORE_EGO
    assert decision(follower(1.0, position_m=150.0), seen(at_overlap(0.5), "e0_1"), memory).mode is Mode.IGNORE_EGO
    assert decision(follower(1.0, position_m=150.0), seen(at_overlap(0.5), "e0_0"), memory).mode is Mode.SUMO
