"""Makers of stored drives on tiny roads, whose map and expert are at hand instead of on the disk."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from interplan_sumo.batch.records import Fault
from interplan_sumo.batch.stored_drive import StoredDrive
from interplan_sumo.scenario.scenario import Jaywalker, LanePosition, Obstacle, Scenario
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.geometry import Pose
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.signals import Signals
from interplan_sumo.world.trace import EgoTrack, Trace
from tests import records
from tests.metrics.staging import scenario_on
from tests.worlds import LANE_WIDTH_M, drive, junction, straight_road

PROFILE = "interplan-paper"
START_M = 10.0
START = Pose(START_M, 0.0, 0.0)
CRUISE_MPS = 10.0
"""A step of a drive at this speed is a metre long."""


@dataclass(frozen=True, eq=False)
class TinyDrive(StoredDrive):
    """A stored drive that needs no files."""

    tiny_roads: Roads
    tiny_expert: EgoTrack

    @property
    def roads(self) -> Roads:
        return self.tiny_roads

    @cached_property
    def expert(self) -> EgoTrack:
        return self.tiny_expert


def tiny_drive(
    speeds_mps: Sequence[float],
    *,
    actors: Sequence[Actors] | Actors | None = None,
    obstacles: tuple[Obstacle, ...] = (),
    jaywalkers: tuple[Jaywalker, ...] = (),
    expert_mps: Sequence[float] | None = None,
    fault: tuple[str, str] | None = None,
    name: str = "idm",
    scenario_id: str = "lane_change_ltd/0",
    reached_goal: bool = False,
    trace: Trace | None = None,
    roads: Roads | None = None,
) -> TinyDrive:
    """A drive along a straight road of one lane, 300 m long, limit 15 m/s, from 10 m on; the goal lies at 290 m.

    Without an expert the ego's own speeds are the expert's.
    """
    road = straight_road(length_m=300.0) if roads is None else roads
    scenario = scenario_on(road, ("11", START_M), ("11", 290.0), obstacles=obstacles, jaywalkers=jaywalkers)
    driven = drive(*speeds_mps, start=START, actors=actors) if trace is None else trace
    expert = drive(*(speeds_mps if expert_mps is None else expert_mps), start=START).ego
    failed = Fault(*fault) if fault else None  # type: ignore[arg-type]
    row = records.row(scenario_id, 1.0, planner=name, fault=failed, reached_goal=reached_goal)
    named: Scenario = replace(scenario, id=scenario_id)
    return TinyDrive(row, named, driven, Path("runs/a"), False, PROFILE, road, expert)


def drive_at_lights(
    *shown: Signals, speed_mps: float = 0.0, from_x_m: float = -30.0, obstacles: tuple[Obstacle, ...] = ()
) -> TinyDrive:
    """A drive along lane 1 of the junction, whose light holds it at -12 m; a frame for each state of the lights."""
    road = junction()
    scenario = scenario_on(road, ("1", 10.0), ("7", 50.0), obstacles=obstacles)
    driven = drive(*[speed_mps] * len(shown), start=Pose(from_x_m, -LANE_WIDTH_M / 2.0, 0.0))
    elsewhere = tiny_drive([], trace=replace(driven, signals=shown), expert_mps=[0.0])
    on_route = replace(scenario, route=("1", "13", "7"))
    return replace(elsewhere, scenario=on_route, tiny_roads=road, tiny_expert=driven.ego)


def parked_at(arc_m: float) -> Obstacle:
    """A car that stands in the lane."""
    return Obstacle(LanePosition("11", arc_m))


def crossing_at(arc_m: float) -> Jaywalker:
    """Somebody who walks across the lane at 1 m/s, from the right."""
    return Jaywalker(LanePosition("11", arc_m, -3.0), LanePosition("11", arc_m, 3.0), 1.0)
