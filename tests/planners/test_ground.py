from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from worlds import junction, road_along, straight_road

from interplan_planners.common.ground import CELL_M, WINDOW_CELLS, Ground
from interplan_planners.common.route_search import lanes_of_route
from interplan_sumo.world.geometry import Floats, Polyline, box_corners
from interplan_sumo.world.roads import Roads

CROSSING = junction()
ROUTE = ("1", "14", "8")
SLANTED = road_along(Polyline(np.array(((0.0, 0.0), (120.0, 70.0), (260.0, 60.0)))), lanes=3, cuts_m=((100.0, 120.0),))


def check(roads: Roads, route: tuple[str, ...], ground: Ground, x_m: Floats, y_m: Floats) -> None:
    """Every answer against the map's own, point by point."""
    under = ground.under(x_m, y_m)
    on_route = lanes_of_route(roads, route)
    drivable = roads.drivable(np.stack((x_m, y_m), axis=1))
    for i, (x, y) in enumerate(zip(x_m.tolist(), y_m.tolist(), strict=True)):
        lanes = {*roads.lanes_at(x, y), *roads.connectors_at(x, y)}
        assert under.on_lane[i] == bool(lanes)
        assert under.on_route[i] == bool(lanes & on_route)
        assert under.drivable[i] == (bool(lanes) or drivable[i])
        assert under.in_intersection[i] == roads.in_intersection(x, y)


@pytest.mark.parametrize(("roads", "route"), [(CROSSING, ROUTE), (SLANTED, ("1", "2"))], ids=["crossing", "slanted"])
@settings(max_examples=5)
@given(seed=st.integers(0, 2**31))
def test_answers_are_those_of_the_polygons(roads: Roads, route: tuple[str, ...], seed: int) -> None:
    rng = np.random.default_rng(seed)
    ground = Ground(roads, lanes_of_route(roads, route))
    assert ground.under(np.zeros((4, 3, 2)), np.zeros((4, 3, 2))).drivable.shape == (4, 3, 2)
    assert ground.under(np.zeros((0, 3, 2)), np.zeros((0, 3, 2))).drivable.shape == (0, 3, 2)
    for middle in rng.uniform(-40.0, 40.0, (3, 2)):  # the same instance, in places it knows and in new ones
        x_m, y_m = (middle[:, None] + rng.normal(0.0, 15.0, (2, 60))).tolist()
        check(roads, route, ground, np.array(x_m), np.array(y_m))


@pytest.mark.parametrize(
    ("x_m", "y_m", "away_m"),
    [(50.0, 1.75, 0.0), (50.0, 2.05, 0.3), (-0.3, 0.0, 0.3), (-0.3, 2.15, 0.5), (50.0, 0.0, 0.0)],
    ids=["on the edge", "beside", "before", "off the corner", "on the road"],
)
def test_how_far_a_point_is_off_the_road_is_a_distance_whatever_the_direction(
    x_m: float, y_m: float, away_m: float
) -> None:
    ground, at = Ground(straight_road(length_m=100.0), ["11"]), (np.array((x_m,)), np.array((y_m,)))
    assert not ground.farther(*at, away_m + 0.01)[0]
    assert away_m == 0.0 or ground.farther(*at, away_m - 0.01)[0]
    assert ground.farther(np.zeros(0), np.zeros(0), 0.3).shape == (0,)


def test_where_many_boundaries_cross_answers_are_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("interplan_planners.common.ground.MOST_CROSSING", 1)
    x_m, y_m = np.random.default_rng(5).uniform(-15.0, 15.0, (2, 300))
    check(CROSSING, ROUTE, Ground(CROSSING, lanes_of_route(CROSSING, ROUTE)), x_m, y_m)


def test_the_window_follows_the_points_and_need_not_hold_them_all() -> None:
    far = 1.5 * WINDOW_CELLS * CELL_M
    ground = Ground(SLANTED, ["11"])
    assert ground.under(np.array((10.0, far)), np.array((5.8, 0.0))).on_lane.tolist() == [True, False]
    road = straight_road(length_m=2000.0)
    ground = Ground(road, ["11"])
    for x_m in np.arange(5.0, 1995.0, 95.0).tolist():
        assert ground.under(np.array((x_m, x_m)), np.array((0.0, 1.8))).on_lane.tolist() == [True, False]


@pytest.mark.parametrize(
    ("x_m", "y_m", "straddles"),
    [
        (50.0, 0.0, False),
        (50.0, -0.5, False),
        (50.0, -0.7, True),
        (50.0, -1.75, True),
        (50.0, 4.0, False),
        (90.0, 0.0, True),  # half on a connector: PDM's rule knows no order of lanes
    ],
)
def test_a_box_straddles_when_it_is_in_several_lanes_and_in_none_entirely(
    x_m: float, y_m: float, straddles: bool
) -> None:
    ground = Ground(straight_road(lanes=2, cuts_m=((90.0, 100.0),)), ["11"])
    corners = box_corners(x_m, y_m, 0.0, 5.176, 2.297)[0]
    sets = ground.under(corners[:, 0], corners[:, 1]).sets
    assert ground.straddles(sets[None, :]).tolist() == [straddles]
