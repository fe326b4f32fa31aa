"""Plans from their files: coordinates turned, ramps led to their carriageways, what follows by rule written out."""

from __future__ import annotations

import math
from pathlib import Path

import msgspec
import yaml
from msgspec.structs import replace

from interplan_sumo.world.roads import DrivingSide
from tools.make_maps.driveways import with_driveways
from tools.make_maps.plan import GORE_M, Plan, Ramp, Road, RoadSection
from tools.make_maps.rules import written_out


def read_plan(file: Path) -> Plan:
    """The plan in a YAML file, turned, its ramps led to their carriageways, its rules written out.

    ValueError names a field that is none, or a place where a rule finds no way.
    """
    plan = msgspec.convert(yaml.safe_load(file.read_text(encoding="utf-8")), Plan)
    cos, sin = math.cos(math.radians(plan.turned_deg)), math.sin(math.radians(plan.turned_deg))

    def turned(x_m: float, y_m: float) -> tuple[float, float]:
        return x_m * cos - y_m * sin, x_m * sin + y_m * cos

    roads = {
        road.name: replace(
            road,
            points=tuple((*turned(*point[:2]), *point[2:]) for point in road.points),
            sections=road.sections or (RoadSection(forward=road.both or road.one, backward=road.both),),
        )
        for road in plan.roads
    }
    for ramp in plan.ramps:
        own = roads[ramp.ramp]
        arm = _ramp_arm(roads[ramp.road], plan.driving_side, ramp)
        points = (*arm, *own.points) if ramp.kind == "exit" else (*own.points, *arm[::-1])
        roads[ramp.ramp] = replace(own, points=points)
    junctions = tuple(
        junction if junction.at is None else replace(junction, at=turned(*junction.at)) for junction in plan.junctions
    )
    rings = tuple(replace(ring, at=turned(*ring.at)) for ring in plan.roundabouts)
    known = tuple(roads.values())
    plan = replace(plan, name=file.stem, roads=known, junctions=junctions, roundabouts=rings)
    return with_driveways(written_out(plan))


def _ramp_arm(road: Road, driving_side: DrivingSide, ramp: Ramp) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Where a ramp begins or ends, tangential to the lane that it takes up, and its bend on that tangent.

    This is the middle of the kerb lane where the taper of the section at
    `ramp.at_m` meets the ramp.
    """
    at = next(i for i, section in enumerate(road.sections) if section.from_m == ramp.at_m)
    before, section = road.sections[at - 1], road.sections[at]
    forward = ramp.direction == "forward"
    both = [one for s in (before, section) if (one := s.forward if forward else s.backward) is not None]
    wide = max(both, key=lambda one: one.lanes)
    outward_m = wide.inner_m + sum(wide.widths_m) - wide.width_m / 2.0 + GORE_M
    side = -1.0 if forward == (driving_side == "right") else 1.0
    # An exit starts behind the taper in the direction of travel, an entry ends before it.
    ahead = (1.0 if forward else -1.0) * (1.0 if ramp.kind == "exit" else -1.0)
    pose = road.axis.pose(ramp.at_m + ahead * section.taper_m / 2.0, side * outward_m)
    heading_rad = pose.heading_rad + (0.0 if forward else math.pi)
    ahead_m, *rounding = ramp.bend
    bend = (pose.x_m + ahead_m * math.cos(heading_rad), pose.y_m + ahead_m * math.sin(heading_rad), *rounding)
    return (pose.x_m, pose.y_m), bend
