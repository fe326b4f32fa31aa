"""Ordinary driving: the fourteen scenario types of nuPlan's challenge, as far as background traffic can stage them.

Each is a family; a planner that masters these and fails on the others shows what the benchmark is about. `TRIP` is
none of the types: a drive through the town with the turns, lights and lane changes that lie on its way.
"""

from __future__ import annotations

from functools import partial
from typing import Any, Final

from interplan_sumo.families.family import Family
from interplan_sumo.families.ordinary_stages import (
    DRIVERS,
    LIGHT_TRAFFIC,
    anywhere,
    bend,
    change_lane,
    cross,
    crosswalk_ahead,
    drive_past,
    fast_road,
    follow,
    kerb_to_park,
    lane_beside,
    light_ahead,
    pass_parked,
    slow_street,
    stand_in_queue,
    stop_behind,
    trip_through_town,
    wait_for_pedestrian,
    ways_out,
    wide_road,
)
from interplan_sumo.scenario.scenario import TrafficDemand
from interplan_sumo.scenario.sites import site_at
from interplan_sumo.world.roads import Turn

_ordinary = partial(Family[Any], ordinary=True)
_lead = partial(site_at, approach_m=20.0, beyond_m=200.0)

STARTING_LEFT_TURN: Final = _ordinary(
    title="Left turn",
    description="Comes to a junction and turns left.",
    suitable=partial(ways_out, Turn.LEFT, None),
    drawn=partial(cross, 0.5, (25.0, 45.0)),
    order=110,
)
STARTING_RIGHT_TURN: Final = _ordinary(
    title="Right turn",
    description="Comes to a junction and turns right.",
    suitable=partial(ways_out, Turn.RIGHT, None),
    drawn=partial(cross, 0.5, (25.0, 45.0)),
    order=120,
)
TRAFFIC_LIGHT_TRAVERSAL: Final = _ordinary(
    title="Straight on at a traffic light",
    description="Comes to a junction with traffic lights and goes straight on.",
    suitable=partial(ways_out, Turn.STRAIGHT, True),
    drawn=partial(cross, 0.7, (30.0, 60.0)),
    order=130,
)
STOPPING_WITH_LEAD: Final = _ordinary(
    title="Stopping behind a leader",
    description="Follows somebody to a traffic light.",
    suitable=light_ahead,
    drawn=stop_behind,
    order=140,
)
HIGH_LATERAL_ACCELERATION: Final = _ordinary(
    title="Bend",
    description="Takes a bend that is felt at the limit.",
    suitable=bend,
    drawn=partial(drive_past, 0.9, LIGHT_TRAFFIC),
    order=150,
)
HIGH_MAGNITUDE_SPEED: Final = _ordinary(
    title="High speed",
    description="Drives fast on a fast road.",
    suitable=fast_road,
    drawn=partial(drive_past, 0.95, LIGHT_TRAFFIC),
    order=160,
)
LOW_MAGNITUDE_SPEED: Final = _ordinary(
    title="Low speed",
    description="Crawls and picks up speed in a slow street.",
    suitable=slow_street,
    drawn=partial(drive_past, 0.1, LIGHT_TRAFFIC),
    order=170,
)
TRAVERSING_PICKUP_DROPOFF: Final = _ordinary(
    title="Pick-up and drop-off",
    description="Passes where people are picked up and dropped: vehicles stand beside the lane.",
    suitable=kerb_to_park,
    drawn=pass_parked,
    order=180,
)
WAITING_FOR_PEDESTRIAN: Final = _ordinary(
    title="Pedestrian on a crosswalk",
    description="Somebody crosses on a crosswalk, where no light holds the ego.",
    suitable=crosswalk_ahead,
    drawn=wait_for_pedestrian,
    order=190,
)
BEHIND_LONG_VEHICLE: Final = _ordinary(
    title="Behind a long vehicle",
    description="Follows a lorry.",
    suitable=_lead,
    drawn=partial(follow, "truck", 1.8, 0.6),
    order=200,
)
STATIONARY_IN_TRAFFIC: Final = _ordinary(
    title="Standing in traffic",
    description="Stands behind others at a traffic light.",
    suitable=light_ahead,
    drawn=stand_in_queue,
    order=210,
)
NEAR_MULTIPLE_VEHICLES: Final = _ordinary(
    title="Among many vehicles",
    description="Dense traffic on a road of several lanes.",
    suitable=wide_road,
    drawn=partial(drive_past, 0.6, TrafficDemand("high", DRIVERS, "low")),
    order=220,
)
CHANGING_LANE: Final = _ordinary(
    title="Lane change at leisure",
    description="Changes to the next lane in light traffic, with time to do it.",
    suitable=lane_beside,
    drawn=change_lane,
    order=230,
)
FOLLOWING_LANE_WITH_LEAD: Final = _ordinary(
    title="Following a leader",
    description="Follows a car along the lane.",
    suitable=_lead,
    drawn=partial(follow, "car", 1.8, 0.7),
    order=240,
)
TRIP: Final = _ordinary(
    title="Trip",
    description="Goes some way through the town, with the turns, lights and lane changes on it.",
    suitable=anywhere,
    drawn=trip_through_town,
    order=250,
    on_request=True,
)
