"""Stages for the start checks: a straight road, its scenarios, and a second drivable strip beside it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import shapely
from worlds import LANE_WIDTH_M, straight_road

from interplan_sumo.families import find_family
from interplan_sumo.scenario.scenario import LanePosition, Obstacle, Scenario
from interplan_sumo.world.roads import Area, Roads

ONE_LANE = straight_road(lanes=1, length_m=300.0, limit_mps=13.9)
"""From the origin towards +x, the centre line of lane 11 is the x axis."""
TWO_LANES = straight_road(lanes=2, length_m=300.0, limit_mps=13.9)
"""Lane 12 lies to the right of lane 11."""


def widened(roads: Roads, width_m: float = LANE_WIDTH_M) -> Roads:
    """The road with a drivable strip on its left that belongs to nobody's direction: as good as an oncoming lane."""
    strip = shapely.box(0.0, LANE_WIDTH_M / 2.0, 300.0, LANE_WIDTH_M / 2.0 + width_m)
    return replace(roads, generic_drivable_areas=(Area("9", strip),))


def narrowed(lane_id: str) -> Roads:
    """A road of two lanes, 11 and 12, of which only the one with this id goes on after 100 m, as 31 or 32."""
    cut = straight_road(lanes=2, length_m=300.0, cuts_m=((100.0, 110.0),))
    kept = next(way for way in cut.connectors.values() if way.from_lane_id == lane_id)
    block = replace(cut.roadblocks[kept.roadblock_id], lane_ids=(kept.id,))
    return replace(cut, connectors={kept.id: kept}, roadblocks={**cut.roadblocks, block.id: block})


def family_problems(scenario: Scenario, roads: Roads) -> list[str]:
    """What the scenario's own family has to say about its start."""
    return [problem for check in find_family(scenario.family).checks for problem in check(scenario, roads)]


def staged(family: str = "test", **changes: Any) -> Scenario:
    """A scenario on lane 11, from 20 m to 200 m, at 10 m/s."""
    base = Scenario(
        id=f"{family}/0",
        family=family,
        map="test",
        start=LanePosition("11", 20.0),
        start_speed_mps=10.0,
        goal=LanePosition("11", 200.0),
        route=("1",),
    )
    return replace(base, **changes)


def cone(arc_m: float, left_m: float = 0.0) -> Obstacle:
    """0.5 m square."""
    return Obstacle(LanePosition("11", arc_m, left_m), "cone")


def car(arc_m: float, left_m: float = 0.0, turned_rad: float = 0.0) -> Obstacle:
    """4.6 m by 1.85 m."""
    return Obstacle(LanePosition("11", arc_m, left_m), "car", turned_rad)
