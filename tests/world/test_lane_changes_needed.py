"""Lane changes that a route asks for, from each of its lanes."""

from __future__ import annotations

from worlds import junction, straight_road

from interplan_sumo.world.lane_changes import lane_changes_needed

ROAD = straight_road(lanes=4, length_m=300.0, cuts_m=((100.0, 120.0),))


def test_needs_grow_sideways_and_not_along() -> None:
    needed = lane_changes_needed(ROAD, ("1", "2", "3"), "34")
    assert {lane: needed[lane] for lane in ("34", "33", "31", "24", "21", "14", "11")} == {
        "34": 0, "33": 1, "31": 3, "24": 0, "21": 3, "14": 0, "11": 3,
    }  # fmt: skip


def test_needs_stay_inside_the_route() -> None:
    needed = lane_changes_needed(ROAD, ("2", "3"), "34")
    assert set(needed) == {*(f"2{i}" for i in range(1, 5)), *(f"3{i}" for i in range(1, 5))}


def test_a_lane_from_which_no_way_leads_to_the_goal_has_no_number() -> None:
    crossing = junction()
    blocks = [crossing[lane].roadblock_id for lane in ("1", "13", "7", "2")]
    needed = lane_changes_needed(crossing, blocks, "7")
    assert {lane: needed.get(lane) for lane in ("7", "13", "1", "2")} == {"7": 0, "13": 0, "1": 0, "2": None}
