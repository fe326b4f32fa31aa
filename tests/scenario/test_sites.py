"""Sites: what lies around a place, the way there and on, and why a place does not do."""

from __future__ import annotations

import pytest
from worlds import straight_road

from interplan_sumo.maps.store import load_roads
from interplan_sumo.scenario.sites import Site, UnsuitableError, places, site_at
from interplan_sumo.world.roads import Roads

LONG = straight_road(lanes=3, length_m=300.0)
CUT = straight_road(lanes=2, length_m=300.0, cuts_m=((100.0, 110.0), (200.0, 210.0)))


def near(roads: Roads, lane: str, at_m: float) -> Site:
    return site_at(roads, lane, at_m, approach_m=60.0, beyond_m=70.0)


def reasons(roads: Roads, step_m: float) -> list[str]:
    """Why places of a map do not do."""
    found: list[str] = []
    for lane, at_m in places(roads, step_m):
        try:
            near(roads, lane, at_m)
        except UnsuitableError as reason:
            found.append(str(reason))
    return found


def test_a_site_knows_its_lane_its_neighbours_the_edges_of_the_road_and_start_and_goal_as_wished() -> None:
    site = near(LONG, "12", 150.0)
    assert (site.lanes_left, site.lanes_right) == (1, 1)
    assert site.width_m == pytest.approx(3.5)
    assert site.left_edge_m == pytest.approx(1.5 * 3.5)
    assert site.right_edge_m == pytest.approx(1.5 * 3.5)
    assert site.oncoming_m == 0.0
    assert site.beside_start == ("11", "12", "13")
    assert (site.start.lane, site.start.arc_m) == ("12", 90.0)
    assert (site.goal.lane, site.goal.arc_m) == ("12", 220.0)
    assert site.route == ("1",)


def test_the_way_leads_over_connectors_to_the_lanes_before_and_behind() -> None:
    site = near(CUT, CUT.roadblocks["3"].lane_ids[0], 40.0)
    assert CUT[site.start.lane].roadblock_id == "1"
    assert CUT[site.goal.lane].roadblock_id in {"3", "5"}
    assert site.route[0] == "1"


@pytest.mark.parametrize(
    ("at_m", "reason"), [(40.0, "the road begins"), (260.0, "the road ends"), (5.0, "an end of the lane is nearer")]
)
def test_a_place_too_near_to_an_end_is_refused_with_the_reason(at_m: float, reason: str) -> None:
    with pytest.raises(UnsuitableError, match=reason):
        near(LONG, "12", at_m)


def test_a_traffic_light_or_a_turn_on_the_way_is_a_reason() -> None:
    found = reasons(load_roads("back_bay"), step_m=40.0)
    for what in ("there is a traffic light", "the road turns off"):
        assert any(what in reason for reason in found)


def test_oncoming_lanes_count_only_where_no_median_parts_them() -> None:
    two_way, divided = load_roads("back_bay"), load_roads("one_north")
    assert near(two_way, "302020", 100.0).oncoming_m == pytest.approx(3.1, abs=0.01)
    assert near(divided, "101051", 150.0).oncoming_m == 0.0


@pytest.mark.parametrize(("name", "lane", "side"), [("back_bay", "301020", -1), ("one_north", "601030", 1)])
def test_the_near_kerb_is_on_the_right_where_one_drives_on_the_right(name: str, lane: str, side: int) -> None:
    site = near(load_roads(name), lane, 100.0)
    assert site.kerb == side
    assert site.place(0.0, 1.0).left_m == side
    assert site.near_edge_m < site.far_edge_m  # the oncoming lane is on the far side
