"""Who reacts to the ego, from which overlap on, and how: pure decisions, no SUMO."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from networks import LANE_Y, two_way_road

from interplan_sumo.simulation import reactions
from interplan_sumo.simulation.lane_polygons import ClipArea, Ring
from interplan_sumo.simulation.network import NetworkLane, NetworkLink, SumoNetwork
from interplan_sumo.simulation.reactions import (
    Agent,
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


def driver(overlap: float, anticipation_s: float = 0.0) -> VehicleType:
    return VehicleType("d", 4.6, 1.85, 1.5, 1.0, 1.0, 2.0, react_overlap=overlap, anticipation_s=anticipation_s)


def follower(overlap: float, lane: str = "e0_1", position_m: float = 60.0, anticipation_s: float = 0.0) -> Agent:
    ahead = reactions.corridor(NETWORK, lane, EASTWARD)
    return Agent("a", driver(overlap, anticipation_s), position_m, 10.0, 15.0, ahead)


def ring(ego: EgoState) -> Ring:
    return [(x, y) for x, y in ego.corners(PACIFICA).tolist()]


def cover(ring: Ring, velocity_mps: tuple[float, float]) -> dict[str, LaneCoverage]:
    area = ClipArea.of(ring)
    return reactions.lane_coverage(NETWORK.pieces_near(area), area, velocity_mps)


def seen(y_m: float, anchor: str, speed_mps: float = 8.0, x_m: float = 100.0, heading_rad: float = 0.0) -> EgoOnNetwork:
    ego = EgoState(0.0, x_m, y_m, heading_rad, vx_mps=speed_mps)
    coverage = cover(ring(ego), (speed_mps, 0.0))
    centre = frozenset(piece.lane.id for piece in NETWORK.pieces[0] if piece.holds(x_m, y_m))
    return EgoOnNetwork(coverage, centre, anchor, x_m + 2.6, speed_mps, True)


def decision(
    agent: Agent, ego: EgoOnNetwork, memory: dict[str, ReactionMemory] | None = None, **rest: bool
) -> ReactionDecision:
    decided = reactions.decide([agent], ego, {}, {} if memory is None else memory, 0.1, **rest)
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
    westward = reactions.corridor(NETWORK, "w0_0", ("w0",))
    agent = Agent("a", driver(0.0), 220.0, 12.0, 15.0, westward)  # 400 - 220 = x 180, coming towards x = 100
    against = decision(agent, seen(1.75, "e0_2"))
    assert against.mode is Mode.OVERRIDE_SPEED
    assert against.speed_mps is not None
    still = decision(agent, seen(1.75, "e0_2", speed_mps=0.0))
    assert still.speed_mps is not None
    assert against.speed_mps < still.speed_mps < 12.0


def test_an_imposed_speed_brakes_no_harder_than_the_emergency_deceleration() -> None:
    close = decision(follower(0.0, position_m=97.0), seen(at_overlap(0.5), "e0_0", speed_mps=0.0))
    assert close.speed_mps == pytest.approx(10.0 - 9.0 * 0.1)


@pytest.mark.parametrize(("position_m", "at_limit"), [(96.4, True), (88.0, False)])
def test_an_agent_that_would_have_to_brake_harder_than_it_can_is_known(position_m: float, at_limit: bool) -> None:
    """The rear of the ego is at 97.4 m and drives at 8 m/s."""
    merged = decision(follower(1.0, position_m=position_m), seen(LANE_Y[1], "e0_1"))
    assert (merged.mode, merged.at_limit) == (Mode.SUMO, at_limit)


@pytest.mark.parametrize(("position_m", "speed_mps"), [(96.4, 10.0 - 0.9), (60.0, 10.1)])
def test_a_speed_imposed_for_another_thing_brakes_for_the_ego_too_but_no_harder_than_brakes_do(
    position_m: float, speed_mps: float
) -> None:
    """SUMO's safe speed, to which an imposed one is cut, would stop the car dead."""
    agent = follower(1.0, position_m=position_m)
    decided = reactions.decide([agent], seen(LANE_Y[1], "e0_1"), {}, {}, 0.1)
    far = {"e0_1": [("b", LaneCoverage(1.0, 300.0, 305.0, 10.0))]}
    told = reactions.yield_to([agent], far, decided, 0.1)["a"]
    assert told.at_limit == (speed_mps < 10.0)
    assert told.speed_mps == pytest.approx(speed_mps, abs=0.05)


def test_anticipation_looks_at_the_swept_box() -> None:
    ego = EgoState(0.0, 100.0, at_overlap(-0.5), 0.2, vx_mps=8.0)
    velocity = (7.84, 1.59)
    box = ring(ego)
    now = cover(box, velocity)
    soon = cover(reactions.swept_area(box, velocity, 2.0), velocity)
    assert "e0_1" not in now
    on_network = EgoOnNetwork(now, frozenset({"e0_0"}), "e0_0", 102.6, 8.0, True)
    agent = follower(0.0, anticipation_s=2.0)
    decided = reactions.decide([agent], on_network, {2.0: soon}, {}, 0.1)
    assert decided["a"].mode is Mode.OVERRIDE_SPEED


def test_the_corridor_runs_on_through_junctions_along_the_route() -> None:
    ahead = reactions.corridor(NETWORK, "e0_1", EASTWARD)
    assert ahead == pytest.approx({"e0_1": 0.0, ":B_1_1": 400.0, "e1_1": 400.1})
    assert reactions.corridor(NETWORK, ":B_1_1", EASTWARD) == pytest.approx({":B_1_1": 0.0, "e1_1": 0.1})


def test_the_corridor_reaches_150_m_beyond_the_own_lane() -> None:
    lines = [Polyline(np.array([[10.0 * i, 0.0], [10.0 * (i + 1), 0.0]])) for i in range(30)]
    lanes = [NetworkLane(f"e{i}_0", f"e{i}", 0, line, 10.0, 3.5, 13.9, internal=False) for i, line in enumerate(lines)]
    links = {a.id: (NetworkLink(a.id, b.id, (), "s", True, None),) for a, b in pairwise(lanes)}
    road = SumoNetwork(Path("none"), {each.id: each for each in lanes}, {}, {**links, "e29_0": ()}, {})
    ahead = reactions.corridor(road, "e0_0", tuple(each.edge for each in lanes))
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
    told = reactions.yield_to([agent], {"e0_1": [fast, standing]}, {}, 0.1)["a"]
    assert told.speed_mps == pytest.approx(speed_mps, abs=2e-3)
