"""The figures that say how like streets a map is, on roads of which they can be told by hand."""

from __future__ import annotations

import numpy as np
import pytest

from interplan_sumo.world.geometry import Polyline
from interplan_sumo.world.roads import Roads, StopLineKind
from tests.maps.road_worlds import Ways, small_roads, straight
from tools.map_yardsticks import table, tightest_radius_m, yardsticks


def street(gap_m: float = 90.0, second_way: bool = True, signs: dict[str, StopLineKind] | None = None) -> Roads:
    """A street with a side street, `gap_m` later another one; without `second_way` the last turns off instead."""
    end_m = 110.0 + gap_m
    lanes = {
        "a1": [straight((0.0, 0.0), (100.0, 0.0))],
        "b2": [straight((110.0, 0.0), (end_m, 0.0))],
        "c3": [straight((end_m + 10.0, 0.0), (end_m + 90.0, 0.0))],
        "d4": [straight((105.0, -10.0), (105.0, -190.0))],
        "e5": [straight((end_m + 5.0, -10.0), (end_m + 5.0, -30.0))],
    }
    if not second_way:
        del lanes["c3"]
    ways = [Ways("a1", "b2"), Ways("a1", "d4"), Ways("b2", "e5", intersection="901")]
    onward = [Ways("b2", "c3", intersection="901")] if second_way else []
    return small_roads(lanes, [*ways, *onward], signs=signs)


def test_junctions_ways_and_blocks_are_counted_along_the_street() -> None:
    found = yardsticks(street())
    assert found.branching == 2
    assert found.per_lane_km == pytest.approx(2.0 / found.lane_km)
    assert found.connectors_per_exit_lane == 2.0
    assert found.block_length_m == pytest.approx((90.0, 90.0, 90.0))
    assert found.lane_width_m == pytest.approx((3.5, 3.5, 3.5), abs=0.01)


@pytest.mark.parametrize(("gap_m", "junctions"), [(9.0, 1), (11.0, 2)])
def test_places_less_than_ten_metres_apart_are_one_junction(gap_m: float, junctions: int) -> None:
    assert yardsticks(street(gap_m)).branching == junctions


def test_where_a_street_only_goes_on_nothing_branches() -> None:
    found = yardsticks(street(second_way=False))
    assert found.branching == 1
    assert np.isnan(found.block_length_m).all()  # no way leads from one junction to another
    assert found.idle_intersections == 1


def test_a_short_way_that_ends_within_the_map_is_a_driveway_unless_a_sign_rules_the_place() -> None:
    assert yardsticks(street()).shares == {"signalled": 0.0, "signed": 0.0, "driveway": 0.5, "unmarked": 0.5}
    signed = street(signs={"b2": StopLineKind.STOP_SIGN})
    assert yardsticks(signed).shares == {"signalled": 0.0, "signed": 0.5, "driveway": 0.0, "unmarked": 0.5}


def test_the_tightest_radius_of_an_arc_is_its_own() -> None:
    angle = np.linspace(0.0, 1.5, 200)
    arc = Polyline(20.0 * np.stack((np.cos(angle), np.sin(angle)), axis=1))
    assert tightest_radius_m(arc) == pytest.approx(20.0, rel=0.01)


def test_the_table_has_a_column_for_each_map() -> None:
    rows = table([yardsticks(street()), yardsticks(street())]).splitlines()
    assert {row.count("|") for row in rows} == {4}
