"""Association: the place of a point depends on what holds it and on where it was."""

from __future__ import annotations

import numpy as np
import pytest

from interplan_sumo.metrics.association import (
    Containment,
    Place,
    body_lanes,
    centre_places,
    corner_places,
    shared_lanes,
)
from interplan_sumo.world.roads import Roads
from tests.worlds import junction, straight_road

CROSSING = junction()
TWO_LANES = straight_road(lanes=2, length_m=100.0, cuts_m=((40.0, 60.0),))


def along(roads: Roads, *points: tuple[float, float]) -> tuple[Place, ...]:
    xy = np.array(points, dtype=np.float64).reshape(-1, 2)
    return centre_places(roads, Containment.of(roads, xy), xy)


def test_a_point_on_an_edge_is_in_no_lane():
    on_the_line, just_left, just_right = (10.0, -1.75), (10.0, -1.7499), (10.0, -1.7501)
    assert along(TWO_LANES, on_the_line) == ((),)
    assert along(TWO_LANES, just_left) == (("11",),)
    assert along(TWO_LANES, just_right) == (("12",),)


def test_on_the_second_frame_connectors_of_the_frame_before_are_not_kept():
    assert along(CROSSING, (-4.0, -1.75), (-6.0, -6.0))[-1] == ()


@pytest.mark.parametrize(("beside", "place"), [((-5.5, -11.7), ("12",)), ((-5.5, -12.3), ())])
def test_a_connector_that_was_left_is_kept_while_the_point_is_in_the_intersection(
    beside: tuple[float, float], place: Place
):
    assert along(CROSSING, (-4.0, -8.0), (-3.5, -9.0), beside)[-1] == place


def test_losing_all_lanes_right_after_ambiguous_connectors_empties_them_too():
    # nuPlan thins a longer list by any list it contains, and every list contains the empty one
    assert along(CROSSING, (-11.9, -1.75), (-11.9, -40.0)) == ((), ())


@pytest.mark.parametrize(
    ("corners", "lanes"),
    [
        ((("11",), ("11",), ("11",), ("11",)), {"11"}),
        ((("11",), ("11",), ("12",), ("12",)), None),
        (((), ("11",), ("11",), ("11",)), None),
        (((), (), (), ()), set[str]()),
        ((("21",), ("11",), ("11",), ("21",)), {"11", "21"}),
        ((("21",), ("21",), ("11",), ("21",)), {"21"}),
        ((("21",), ("11",), ("11",), ("22",)), None),
        ((("31",), ("11",), ("11",), ("31",)), {"21"}),
    ],
    ids=["inside", "astride", "one off", "all off", "into the next", "rear askew", "front parts", "over a short one"],
)
def test_the_lanes_that_hold_the_body(corners: tuple[Place, Place, Place, Place], lanes: set[str] | None):
    assert shared_lanes(TWO_LANES, corners) == lanes
    assert body_lanes(TWO_LANES, [corners, corners])[1] == lanes


def test_a_rear_in_two_connectors_that_join_is_astride():
    assert shared_lanes(CROSSING, (("5",), ("21",), ("31",), ("5",))) is None


@pytest.mark.parametrize(("frames_off", "place"), [(1, ("12",)), (2, ("12", "13", "14"))])
def test_only_on_the_second_frame_is_what_one_corner_finds_offered_to_the_next(frames_off: int, place: Place):
    off, unambiguous, ambiguous = (-40.0, -40.0), (-7.0, -5.0), (-7.0, -2.0)
    points = np.array([*[off] * 4 * frames_off, unambiguous, ambiguous, off, off])
    rows = np.arange(len(points)).reshape(-1, 4).tolist()
    assert corner_places(CROSSING, Containment.of(CROSSING, points), rows)[-1] == (("12",), place, (), ())


def test_a_map_without_intersections_or_connectors_can_be_asked():
    roads = straight_road(length_m=20.0)
    inside = Containment.of(roads, np.array([[5.0, 0.0], [5.0, 9.0]]))
    assert inside.lanes == (("11",), ())
    assert not inside.in_intersection.any()
