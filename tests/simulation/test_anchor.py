"""The lane on which SUMO sees the ego: the nearest of its own direction, held to its route, as a full search finds."""

from __future__ import annotations

from math import cos
from pathlib import Path

import numpy as np
import pytest
import shapely
from networks import LANE_Y, WESTWARD_Y, two_way_road

from interplan_sumo.maps.store import find_map
from interplan_sumo.simulation.anchor import (
    LANE_CHANGE_PENALTY_M,
    OFF_ROUTE_PENALTY_M,
    REACH_M,
    Anchor,
    find_anchor,
)
from interplan_sumo.simulation.network import NetworkLane, SumoNetwork, read_network
from interplan_sumo.world.geometry import Polyline
from tests.quick import DISTRICTS

ROAD = two_way_road()
EASTWARD = ("e0", "e1")


def anchored(x_m: float, y_m: float, before: Anchor | None = None, heading_rad: float = 0.0) -> Anchor | None:
    return find_anchor(ROAD, (x_m, y_m), heading_rad, before, EASTWARD)


def test_the_ego_is_seen_on_the_centre_line_of_its_lane() -> None:
    found = anchored(120.0, LANE_Y[1] + 0.8)
    assert found is not None
    assert (found.lane, found.position_m, found.x_m, found.y_m) == ("e0_1", 120.0, 120.0, LANE_Y[1])
    assert found.on_route


@pytest.mark.parametrize(("beyond_m", "lane"), [(-0.01, "e0_0"), (0.1, "e0_0"), (0.16, "e0_1")])
def test_a_new_lane_holds_the_anchor_once_it_is_nearer_by_the_penalty(beyond_m: float, lane: str) -> None:
    before = anchored(100.0, LANE_Y[0])
    found = anchored(100.8, (LANE_Y[0] + LANE_Y[1]) / 2.0 + beyond_m, before)
    assert found is not None
    assert found.lane == lane
    assert pytest.approx(0.3) == LANE_CHANGE_PENALTY_M  # half of it on either side of the middle


def test_in_the_oncoming_lane_the_nearest_lane_of_the_own_direction_holds_the_anchor() -> None:
    found = anchored(150.0, WESTWARD_Y, anchored(149.0, LANE_Y[2]))
    assert found is not None
    assert (found.lane, found.y_m) == ("e0_2", LANE_Y[2])


@pytest.mark.parametrize(("away_m", "seen"), [(REACH_M - 0.1, True), (REACH_M + 0.1, False)])
def test_far_from_all_lanes_there_is_no_anchor(away_m: float, seen: bool) -> None:
    kerb_m = LANE_Y[0] - 1.75
    assert (anchored(100.0, kerb_m - away_m) is not None) == seen


@pytest.mark.parametrize(("apart_m", "lane"), [(4.8, "on_0"), (5.2, "off_0")])
def test_a_lane_off_the_route_holds_the_anchor_if_it_is_nearer_by_more_than_five_metres(
    apart_m: float, lane: str
) -> None:
    lines = {
        "off_0": Polyline(np.array([[0.0, 0.0], [99.0, 0.0]])),
        "on_0": Polyline(np.array([[0.0, apart_m], [99.0, apart_m]])),
    }
    lanes = {name: NetworkLane(name, name[:-2], 0, line, 99.0, 3.5, 13.9, False) for name, line in lines.items()}
    network = SumoNetwork(Path("none"), lanes, {name[:-2]: (name,) for name in lanes}, dict.fromkeys(lanes, ()))
    found = find_anchor(network, (50.0, -3.0), 0.0, None, ("on",))
    assert found is not None
    assert found.lane == lane


def searched(
    network: SumoNetwork, front: tuple[float, float], heading_rad: float, before: Anchor | None, route: tuple[str, ...]
) -> tuple[str, float] | None:
    """Lane and position of the anchor, by looking at every piece."""
    kept = network.continuations(before.lane) if before is not None else frozenset[str]()
    pieces, _ = network.pieces
    away_m = shapely.distance([piece.polygon for piece in pieces], shapely.Point(front))
    for reach_m in (LANE_CHANGE_PENALTY_M, REACH_M):
        best: tuple[float, str, float] | None = None
        for i in np.flatnonzero(away_m <= reach_m).tolist():
            piece = pieces[i]
            arc_m, lateral_m = piece.line.project_point(*front)
            if cos(piece.line.pose_at(arc_m).heading_rad - heading_rad) < 0.0:
                continue
            cost = abs(lateral_m) + (0.0 if network.on_route(piece.lane.id, route) else OFF_ROUTE_PENALTY_M)
            cost += 0.0 if piece.lane.id in kept else LANE_CHANGE_PENALTY_M
            if best is None or (cost, piece.lane.id) < best[:2]:
                best = (cost, piece.lane.id, piece.lane.position_of(piece.start_m + arc_m))
        if best is not None:
            return best[1:]
    return None


@pytest.mark.parametrize("name", DISTRICTS)
def test_the_anchor_is_that_of_a_search_over_all_lanes(name: str) -> None:
    network = read_network(find_map(name).network)
    rng = np.random.default_rng(2)
    lanes = list(network.lanes.values())
    for _ in range(40):
        at = lanes[int(rng.integers(len(lanes)))]
        pose = at.line.pose_at(rng.uniform() * at.line.length_m, rng.uniform(-12.0, 12.0))
        heading_rad = pose.heading_rad + float(rng.choice((0.0, rng.normal(0.0, 0.4), np.pi)))
        route = (at.edge,) if not at.internal and rng.random() < 0.5 else ()
        front = (pose.x_m, pose.y_m)
        found = find_anchor(network, front, heading_rad, None, route)
        expected = searched(network, front, heading_rad, None, route)
        assert (found is None) == (expected is None)
        if found is not None:
            assert (found.lane, found.position_m) == pytest.approx(expected)
