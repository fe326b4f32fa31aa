"""Drivable area: a corner may hang over the edge by less than the tolerance."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely

from interplan_sumo.metrics.drivable_area import drivable_area
from interplan_sumo.world.roads import Area
from tests.metrics.staging import drive_at, facts_of
from tests.worlds import straight_road

ROAD = straight_road(length_m=200.0)
EDGE_M = 1.75 - 2.297 / 2
"""With the centre this far left of the centre line the left side is on the edge."""


def test_one_frame_outside_is_enough_and_is_named():
    result = drivable_area(facts_of(drive_at(np.arange(50.0, 55.0), [0.0, 0.0, EDGE_M + 0.4, 0.0, 0.0]), ROAD))
    assert result.score == 0.0
    assert str(result.reason).partition(";")[0] == "front left corner 0.40 m off the drivable area at 0.2 s"
    assert result.series["corners_inside"].tolist() == [True, True, False, True, True]
    assert result.detail["frames_outside"] == 1
    assert result.detail["all_corners_inside"] is False


def test_lanes_themselves_are_drivable_but_their_surroundings_are_not_without_an_area():
    lanes_only = replace(ROAD, road_segments=())
    assert drivable_area(facts_of(drive_at([50.0, 51.0], 0.0), lanes_only)).score == 1.0
    near_the_lane = drivable_area(facts_of(drive_at([50.0, 51.0], EDGE_M + 0.29), lanes_only))
    assert near_the_lane.score == 1.0
    off_the_lane = drivable_area(facts_of(drive_at([50.0, 51.0], EDGE_M + 0.31), lanes_only))
    assert off_the_lane.score == 0.0


@pytest.mark.parametrize("layer", ["road_segments", "generic_drivable_areas", "carparks"])
def test_every_drivable_layer_counts(layer: str):
    beside = Area("77", shapely.box(0.0, 1.5, 200.0, 6.0))
    wider: dict[str, Any] = {layer: (*getattr(ROAD, layer), beside)}
    roads = replace(ROAD, **wider)
    facts = facts_of(drive_at([50.0, 51.0], 3.0), roads)
    assert drivable_area(facts).score == 1.0
    assert drivable_area(facts_of(drive_at([50.0, 51.0], 3.0), ROAD)).score == 0.0


def test_far_from_any_road_the_score_is_zero_and_the_distance_finite():
    result = drivable_area(facts_of(drive_at([50.0, 51.0], 500.0), ROAD))
    assert result.score == 0.0
    assert 490.0 < result.detail["farthest_m"] < 510.0
