"""Overtake: a parked vehicle blocks the lane of a two-way road; wait for a gap, use the oncoming lane, come back."""

from __future__ import annotations

from typing import Final

import numpy as np

from interplan_sumo.errors import ScenarioError
from interplan_sumo.families.shapes import CLEARANCE_M, LARGEST_OFFSET_M, PASSING_M, start_speed_mps
from interplan_sumo.scenario.scenario import (
    OBSTACLES,
    Behaviour,
    Density,
    LanePosition,
    Obstacle,
    ObstacleKind,
    PlacedVehicle,
    Scenario,
    TrafficDemand,
)
from interplan_sumo.scenario.sites import Site, UnsuitableError, roomiest_site_at
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.roads import Roads

APPROACH_M: Final = 70.0
BEYOND_M: Final = 80.0
FASTEST_MPS: Final = 16.0


def overtake(
    id: str,
    *,
    site: Site,
    offset_m: float,
    oncoming: Density = "none",
    flow: bool = False,
    behind_m: tuple[float, ...] = (),
    kind: ObstacleKind = "car",
    behaviour: Behaviour = "mixed",
) -> Scenario:
    """A parked vehicle that one passes, 0.3 m clear, `offset_m` off the lane's centre line, on the oncoming side.

    With `flow` the oncoming traffic does not end. `behind_m` are the distances,
    centre to centre, of cars that follow the ego at its speed. ScenarioError if
    the road has no room, or if the ego could stay on its own side.
    """
    _, _, width_m = OBSTACLES[kind]
    if offset_m <= max(LARGEST_OFFSET_M, site.width_m / 2.0):
        raise ScenarioError(f"{id}: offset_m is {offset_m}: the ego could pass on its own side; use nudge()")
    needed_m = offset_m + PACIFICA.width_m / 2.0 + CLEARANCE_M
    if needed_m > site.width_m / 2.0 + site.oncoming_m:
        raise ScenarioError(
            f"{id}: passing takes {needed_m:.2f} m beside the lane's centre line, "
            f"the road has {site.width_m / 2.0 + site.oncoming_m:.2f} m"
        )
    parked = Obstacle(site.place(0.0, PASSING_M - offset_m + width_m / 2.0), kind)
    speed_mps = start_speed_mps(site)
    followers = [
        PlacedVehicle(LanePosition(site.start.lane, round(site.start.arc_m - d, 2)), speed_mps) for d in behind_m
    ]
    return Scenario(
        id=id,
        family="overtake",
        map=site.map,
        start=site.start,
        start_speed_mps=speed_mps,
        goal=site.goal,
        route=site.route,
        traffic=TrafficDemand(oncoming=oncoming, behaviour=behaviour, flow=flow),
        obstacles=(parked,),
        vehicles=tuple(followers),
        exempt=("driving_direction",),
    )


def suitable(roads: Roads, lane_id: str, at_m: float) -> Site:
    """A two-way road with one lane per direction and room to pass; UnsuitableError otherwise."""
    site = roomiest_site_at(roads, lane_id, at_m, approach_m=APPROACH_M, beyond_m=BEYOND_M)
    if site.limit_mps > FASTEST_MPS:
        raise UnsuitableError(f"the limit is {site.limit_mps:.1f} m/s, cars park on roads of {FASTEST_MPS} or less")
    if site.lanes_near + site.lanes_far:
        raise UnsuitableError("there is a second lane in the own direction")
    if site.oncoming_m < PACIFICA.width_m + CLEARANCE_M:
        raise UnsuitableError("there is no oncoming lane beside it")
    return site


def drawn(id: str, site: Site, rng: np.random.Generator) -> Scenario:
    """A scenario of the family at a site, what varies drawn at random."""
    least_m = max(LARGEST_OFFSET_M, site.width_m / 2.0) + 0.1
    most_m = min(site.width_m / 2.0 + site.oncoming_m - PASSING_M, least_m + 0.8)
    if most_m < least_m:
        raise UnsuitableError("the oncoming lane is too narrow to pass on")
    densities: tuple[Density, ...] = ("none", "low", "medium")
    oncoming = densities[int(rng.integers(3))]
    followers = tuple(d for d in (15.0, 32.0) if site.start.arc_m - d > 5.0 and rng.random() < 0.3)
    return overtake(
        id,
        site=site,
        offset_m=float(np.round(rng.uniform(least_m, most_m), 2)),
        oncoming=oncoming,
        flow=oncoming == "low" and bool(rng.random() < 0.5),  # denser traffic without an end leaves no gap
        behind_m=followers,
        behaviour=("conservative", "assertive", "mixed")[int(rng.integers(3))],
    )


# --- the ten -----------------------------------------------------------------------------------

SCENARIOS: Final[tuple[Scenario, ...]] = (
    overtake(  # nobody comes
        "overtake/0",
        site=Site(
            map="hazelwood",
            lane="441010",
            at_m=110.0,
            start=LanePosition("441010", 40.0),
            goal=LanePosition("441010", 190.0),
            route=("44101",),
            driving_side="right",
            limit_mps=11.11,
            width_m=3.3,
            left_edge_m=7.15,
            right_edge_m=3.85,
            beside_start=("441010",),
            oncoming_m=3.3,
            bend_rad=-0.43,
        ),
        offset_m=1.9,
    ),
    overtake(  # light oncoming traffic
        "overtake/1",
        site=Site(
            map="hazelwood",
            lane="422030",
            at_m=110.0,
            start=LanePosition("422030", 40.0),
            goal=LanePosition("422030", 190.0),
            route=("42203",),
            driving_side="right",
            limit_mps=11.11,
            width_m=3.3,
            left_edge_m=4.95,
            right_edge_m=1.65,
            beside_start=("422030",),
            oncoming_m=3.3,
            bend_rad=0.72,
        ),
        offset_m=2.1,
        oncoming="low",
        flow=True,
        behaviour="conservative",
    ),
    overtake(  # a faster road
        "overtake/2",
        site=Site(
            map="hazelwood",
            lane="202130",
            at_m=95.0,
            start=LanePosition("202130", 25.0),
            goal=LanePosition("202130", 175.0),
            route=("20213",),
            driving_side="right",
            limit_mps=15.56,
            width_m=3.6,
            left_edge_m=5.4,
            right_edge_m=1.8,
            beside_start=("202130",),
            oncoming_m=3.6,
        ),
        offset_m=2.2,
        oncoming="medium",
        behaviour="mixed",
    ),
    overtake(  # left-hand traffic, a bend
        "overtake/3",
        site=Site(
            map="one_north",
            lane="801010",
            at_m=95.0,
            start=LanePosition("801010", 25.0),
            goal=LanePosition("801020", 6.0),
            route=("80101", "801010", "80102"),
            driving_side="left",
            limit_mps=13.89,
            width_m=3.4,
            left_edge_m=1.7,
            right_edge_m=5.1,
            beside_start=("801010",),
            oncoming_m=3.4,
            bend_rad=-0.47,
        ),
        offset_m=2.0,
        oncoming="low",
        behaviour="assertive",
    ),
    overtake(  # nobody comes, two behind
        "overtake/4",
        site=Site(
            map="one_north",
            lane="402030",
            at_m=150.0,
            start=LanePosition("402030", 80.0),
            goal=LanePosition("402040", 40.67),
            route=("40203", "402031", "40204"),
            driving_side="left",
            limit_mps=13.89,
            width_m=3.6,
            left_edge_m=1.8,
            right_edge_m=5.4,
            beside_start=("402030",),
            oncoming_m=3.6,
            bend_rad=-0.56,
        ),
        offset_m=2.3,
        behind_m=(15.0, 33.0),
    ),
    overtake(  # left-hand traffic, a bend
        "overtake/5",
        site=Site(
            map="one_north",
            lane="602030",
            at_m=90.0,
            start=LanePosition("602030", 20.0),
            goal=LanePosition("602040", 6.0),
            route=("60203", "602030", "60204"),
            driving_side="left",
            limit_mps=13.89,
            width_m=3.4,
            left_edge_m=1.7,
            right_edge_m=5.1,
            beside_start=("602030",),
            oncoming_m=3.4,
            bend_rad=-0.25,
        ),
        offset_m=1.9,
        oncoming="medium",
        flow=True,
        behaviour="conservative",
    ),
    overtake(  # dense oncoming traffic in a narrow street
        "overtake/6",
        site=Site(
            map="back_bay",
            lane="302040",
            at_m=100.0,
            start=LanePosition("302040", 30.0),
            goal=LanePosition("302040", 180.0),
            route=("30204",),
            driving_side="right",
            limit_mps=8.89,
            width_m=3.1,
            left_edge_m=6.85,
            right_edge_m=3.75,
            beside_start=("302040",),
            oncoming_m=3.1,
        ),
        offset_m=1.7,
        oncoming="high",
        behaviour="conservative",
    ),
    overtake(  # one behind
        "overtake/7",
        site=Site(
            map="back_bay",
            lane="622050",
            at_m=105.0,
            start=LanePosition("622050", 35.0),
            goal=LanePosition("622050", 185.0),
            route=("62205",),
            driving_side="right",
            limit_mps=11.11,
            width_m=3.3,
            left_edge_m=4.95,
            right_edge_m=1.65,
            beside_start=("622050",),
            oncoming_m=3.3,
        ),
        offset_m=1.9,
        oncoming="low",
        flow=True,
        behind_m=(16.0,),
        behaviour="mixed",
    ),
    overtake(  # one behind, several coming
        "overtake/8",
        site=Site(
            map="strip",
            lane="601060",
            at_m=90.0,
            start=LanePosition("601060", 20.0),
            goal=LanePosition("601070", 6.0),
            route=("60106", "601060", "60107"),
            driving_side="right",
            limit_mps=13.33,
            width_m=3.6,
            left_edge_m=7.8,
            right_edge_m=4.2,
            beside_start=("601060",),
            oncoming_m=3.6,
            bend_rad=0.18,
        ),
        offset_m=2.3,
        oncoming="medium",
        flow=True,
        behind_m=(14.0,),
        behaviour="assertive",
    ),
    overtake(  # dense oncoming traffic in a long bend
        "overtake/9",
        site=Site(
            map="strip",
            lane="702020",
            at_m=150.0,
            start=LanePosition("702020", 80.0),
            goal=LanePosition("702020", 230.0),
            route=("70202",),
            driving_side="right",
            limit_mps=13.33,
            width_m=3.5,
            left_edge_m=5.25,
            right_edge_m=1.75,
            beside_start=("702020",),
            oncoming_m=3.5,
            bend_rad=-0.26,
        ),
        offset_m=2.2,
        oncoming="high",
        behaviour="mixed",
    ),
)
