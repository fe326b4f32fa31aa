"""What becomes a lane and what a connector."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from interplan_sumo.maps.importers.lane_segments import JOINT_M, MARGIN_M, STUB_M, LaneSegment, lane_segments, links
from interplan_sumo.maps.importers.sections import LaneSection, sections
from interplan_sumo.maps.importers.source import SourceMap
from interplan_sumo.world.roads import StopLineKind
from tests.maps.source_worlds import (
    WIDTH_M,
    crossing,
    fork,
    junction_with_flags,
    lane,
    linked,
    neighbours,
    road_of_two,
    straight,
    world,
)


def parts(source: SourceMap) -> dict[tuple[str, ...], tuple[LaneSegment, ...]]:
    """Segments of each section, by the lanes of its first row."""
    found = sections(source)
    made = lane_segments(source.lanes, found, links(source.lanes, found))
    return {section.rows[0]: own for section, own in zip(found, made, strict=True)}


def shape(found: tuple[LaneSegment, ...]) -> str:
    return "".join("L" if segment.is_lane else "C" for segment in found)


def only(source: SourceMap) -> LaneSection:
    (section,) = sections(source)
    return section


def test_lanes_that_only_follow_one_another_are_one_section() -> None:
    section = only(road_of_two())
    assert section.rows == (("a1", "b1"), ("a2", "b2"))
    assert section.seams_m == pytest.approx((0.0, 50.0, 120.0))
    assert [s.source_id for s in section.stretches(1, 40.0, 60.0)] == ["b1", "b2"]
    first, second = section.stretches(0, 40.0, 64.0)
    assert (first.from_share, first.to_share, first.length_m) == pytest.approx((0.8, 1.0, 10.0))
    assert (second.from_share, second.to_share, second.length_m) == pytest.approx((0.0, 0.2, 14.0))


@pytest.mark.parametrize(
    ("before", "after", "sections_found"),
    [
        ({}, {}, 1),
        ({}, {"speed_limit_mps": 9.0}, 2),
        ({}, {"in_intersection": True}, 2),
        ({}, {"lights_at_start": ("7",)}, 2),
        ({"lights_at_end": ("7",)}, {}, 2),
        ({"sign_at_end": StopLineKind.YIELD}, {}, 2),
    ],
)
def test_a_section_ends_where_something_changes_and_at_a_light_or_a_sign(
    before: dict[str, Any], after: dict[str, Any], sections_found: int
) -> None:
    lanes = linked([straight("a", 0, 50, **before), straight("b", 50, 100, **after)], [("a", "b")])
    assert len(sections(world(lanes))) == sections_found


def test_a_section_ends_where_a_lane_is_added() -> None:
    lanes = linked([straight("a", 0, 50), straight("b", 50, 100), straight("c", 50, 100, -WIDTH_M)], [("a", "b")])
    assert {s.rows[0] for s in sections(world(neighbours(lanes, "b", "c")))} == {("a",), ("b", "c")}


@pytest.mark.parametrize(("apart_m", "rows"), [(0.5, 1), (0.7, 2)])
def test_neighbours_share_their_boundary(apart_m: float, rows: int) -> None:
    lanes = linked([straight("a", 0, 50), straight("b", 0, 50, -WIDTH_M - apart_m)], [])
    assert len(sections(world(neighbours(lanes, "a", "b")))) == rows


def test_a_ring_of_lanes_is_one_section() -> None:
    quarter = [[20.0 * np.cos(a), 20.0 * np.sin(a)] for a in np.linspace(0.0, np.pi / 2.0, 12)]
    turned = [[[-y, x] for x, y in quarter], [[-x, -y] for x, y in quarter], [[y, -x] for x, y in quarter]]
    lanes = [lane(str(k), points) for k, points in enumerate((quarter, *turned))]
    ring = linked(lanes, [("0", "1"), ("1", "2"), ("2", "3"), ("3", "0")])
    found = parts(world(ring))
    assert [len(section.rows) for section in sections(world(ring))] == [4]
    (own,) = found.values()
    assert shape(own) == "CLC"  # the joint at which it closes


def test_direct_joins_get_half_a_metre_of_either_lane() -> None:
    lanes = linked([straight("a", 0, 50, speed_limit_mps=9.0), straight("b", 50, 100)], [("a", "b")])
    found = parts(world(lanes))
    assert shape(found["a",]) == "LC"
    assert shape(found["b",]) == "CL"
    assert found["a",][1] == LaneSegment(50.0 - JOINT_M, 50.0, False)
    assert found["b",][0].end_m == pytest.approx(JOINT_M)


def test_at_a_fork_what_overlaps_becomes_connectors() -> None:
    """Lanes 3.5 m wide on a bend of 20 m overlap by a quarter of it until 2.6 m apart, about 10 m on."""
    found = parts(fork())
    assert shape(found["in",]) == "L"
    assert shape(found["on",]) == "CL"
    assert shape(found["off",]) == "CL"
    assert 9.0 < found["on",][0].end_m < 12.5
    assert found["off",][0].end_m == pytest.approx(found["on",][0].end_m, abs=1.5)


def test_where_lanes_cross_both_are_cut() -> None:
    for (own,), parts_of in parts(crossing()).items():
        assert shape(parts_of) == "LCL", own
        middle = parts_of[1]
        assert middle.start_m == pytest.approx(50.0 - WIDTH_M / 2.0 - MARGIN_M, abs=1.1)
        assert middle.length_m == pytest.approx(WIDTH_M + 2.0 * MARGIN_M, abs=1.1)


@pytest.mark.parametrize(("overlap_m", "kinds"), [(0.8, {"L"}), (1.0, {"C"})])
def test_a_quarter_of_the_width_may_overlap(overlap_m: float, kinds: set[str]) -> None:
    """3.5 m wide: 0.875 m."""
    lanes = {"a": straight("a", 0, 50), "b": straight("b", 0, 50, WIDTH_M - overlap_m)}
    middles = {shape(own)[len(own) // 2] for own in parts(world(lanes)).values()}
    assert middles == kinds


def test_what_the_file_calls_an_intersection_is_connectors_from_end_to_end() -> None:
    found = parts(junction_with_flags())
    assert shape(found["through",]) == "C"
    assert shape(found["turn",]) == "C"
    assert shape(found["in",]) == shape(found["out",]) == shape(found["side",]) == "L"


def test_an_overlap_that_leads_out_of_the_map_ends_in_a_stub() -> None:
    lanes = linked([straight("in", 0, 50), straight("through", 50, 70, in_intersection=True)], [("in", "through")])
    found = parts(world(lanes))
    assert shape(found["through",]) == "CL"
    assert found["through",][1].length_m == pytest.approx(STUB_M)


@pytest.mark.parametrize(("between_m", "expected"), [(17.0, "LCL"), (28.0, "LCLCL")])
def test_nobody_waits_between_two_crossings_that_lie_close(between_m: float, expected: str) -> None:
    """A free stretch of less than 20 m between two overlaps belongs to the intersection."""
    lanes = {
        "east": straight("east", 0, 150),
        "north": lane("north", ((50.0, -50.0), (50.0, 50.0))),
        "south": lane("south", ((50.0 + between_m, 50.0), (50.0 + between_m, -50.0))),
    }
    assert shape(parts(world(lanes))["east",]) == expected


@pytest.mark.parametrize(("length_m", "expected"), [(1.4, "C"), (1.6, "CLC")])
def test_a_very_short_lane_between_two_others_is_a_connector(length_m: float, expected: str) -> None:
    lanes = [straight("a", 0, 50, speed_limit_mps=9.0), straight("b", 50, 50 + length_m)]
    lanes.append(straight("c", 50 + length_m, 100, speed_limit_mps=9.0))
    assert shape(parts(world(linked(lanes, [("a", "b"), ("b", "c")])))["b",]) == expected
