"""Nudge: a parked car stands half in the lane; pass it on the own side with a moderate lateral offset."""

from __future__ import annotations

from typing import Final

import numpy as np

from interplan_sumo.errors import ScenarioError
from interplan_sumo.families.shapes import LARGEST_OFFSET_M, PASSING_M, start_speed_mps
from interplan_sumo.scenario.scenario import OBSTACLES, LanePosition, Obstacle, ObstacleKind, Scenario
from interplan_sumo.scenario.sites import Site, UnsuitableError, roomiest_site_at
from interplan_sumo.world.roads import Roads

APPROACH_M: Final = 70.0
BEYOND_M: Final = 80.0
FASTEST_MPS: Final = 16.0
"""Nobody parks half in the lane on faster roads."""


def nudge(id: str, *, site: Site, offset_m: float, kind: ObstacleKind = "car", turned_rad: float = 0.0) -> Scenario:
    """A parked vehicle that one passes, 0.3 m clear, `offset_m` off the lane's centre line.

    `turned_rad` turns its nose towards the road.
    """
    if not 0.0 < offset_m <= LARGEST_OFFSET_M:
        raise ScenarioError(
            f"{id}: offset_m is {offset_m}, expected more than 0 and at most {LARGEST_OFFSET_M}; "
            "use overtake() where the oncoming lane is needed"
        )
    _, length_m, width_m = OBSTACLES[kind]
    half_m = abs(np.sin(turned_rad)) * length_m / 2.0 + abs(np.cos(turned_rad)) * width_m / 2.0
    towards_kerb_m = PASSING_M - offset_m + float(half_m)
    parked = Obstacle(site.place(0.0, towards_kerb_m), kind, turned_rad=round(-site.kerb * turned_rad, 3) + 0.0)
    return Scenario(
        id=id,
        family="nudge",
        map=site.map,
        start=site.start,
        start_speed_mps=start_speed_mps(site),
        goal=site.goal,
        route=site.route,
        obstacles=(parked,),
    )


def suitable(roads: Roads, lane_id: str, at_m: float) -> Site:
    """A kerb lane of a road that is not too fast, and wide enough to pass on; UnsuitableError otherwise."""
    site = roomiest_site_at(roads, lane_id, at_m, approach_m=APPROACH_M, beyond_m=BEYOND_M)
    if site.limit_mps > FASTEST_MPS:
        raise UnsuitableError(f"the limit is {site.limit_mps:.1f} m/s, cars park on roads of {FASTEST_MPS} or less")
    if site.lanes_near:
        raise UnsuitableError("it is not the lane at the kerb")
    if site.far_edge_m < LARGEST_OFFSET_M + PASSING_M:
        raise UnsuitableError(f"the road ends {site.far_edge_m:.1f} m beside the lane's centre line: no room to pass")
    return site


def drawn(id: str, site: Site, rng: np.random.Generator) -> Scenario:
    """A scenario of the family at a site, what varies drawn at random."""
    largest_m = min(LARGEST_OFFSET_M, site.width_m / 2.0)  # the ego's centre stays in its lane
    return nudge(
        id,
        site=site,
        offset_m=float(np.round(rng.uniform(0.5, largest_m), 2)),
        turned_rad=float(np.round(rng.uniform(-0.1, 0.1), 2)),
    )


# --- the ten -----------------------------------------------------------------------------------

SCENARIOS: Final[tuple[Scenario, ...]] = (
    nudge(  # a narrow street, straight
        "nudge/0",
        site=Site(
            map="back_bay",
            lane="301010",
            at_m=110.0,
            start=LanePosition("301010", 40.0),
            goal=LanePosition("301010", 190.0),
            route=("30101",),
            driving_side="right",
            limit_mps=8.89,
            width_m=3.1,
            left_edge_m=6.85,
            right_edge_m=3.75,
            beside_start=("301010",),
            oncoming_m=3.1,
        ),
        offset_m=0.8,
    ),
    nudge(  # as before, further out
        "nudge/1",
        site=Site(
            map="back_bay",
            lane="301030",
            at_m=110.0,
            start=LanePosition("301030", 40.0),
            goal=LanePosition("301030", 190.0),
            route=("30103",),
            driving_side="right",
            limit_mps=8.89,
            width_m=3.1,
            left_edge_m=6.85,
            right_edge_m=3.75,
            beside_start=("301030",),
            oncoming_m=3.1,
        ),
        offset_m=1.2,
    ),
    nudge(  # a slight bend
        "nudge/2",
        site=Site(
            map="hazelwood",
            lane="411010",
            at_m=120.0,
            start=LanePosition("411010", 50.0),
            goal=LanePosition("411010", 200.0),
            route=("41101",),
            driving_side="right",
            limit_mps=11.11,
            width_m=3.3,
            left_edge_m=4.95,
            right_edge_m=1.65,
            beside_start=("411010",),
            oncoming_m=3.3,
            bend_rad=-0.25,
        ),
        offset_m=0.9,
    ),
    nudge(  # a sharp bend
        "nudge/3",
        site=Site(
            map="hazelwood",
            lane="431020",
            at_m=120.0,
            start=LanePosition("431020", 50.0),
            goal=LanePosition("431020", 200.0),
            route=("43102",),
            driving_side="right",
            limit_mps=11.11,
            width_m=3.3,
            left_edge_m=4.95,
            right_edge_m=1.65,
            beside_start=("431020",),
            oncoming_m=3.3,
            bend_rad=0.34,
        ),
        offset_m=1.3,
    ),
    nudge(  # left-hand traffic, a bend
        "nudge/4",
        site=Site(
            map="one_north",
            lane="502010",
            at_m=90.0,
            start=LanePosition("502010", 20.0),
            goal=LanePosition("502020", 6.0),
            route=("50201", "502010", "50202"),
            driving_side="left",
            limit_mps=11.11,
            width_m=3.3,
            left_edge_m=4.05,
            right_edge_m=7.35,
            beside_start=("502010",),
            oncoming_m=3.3,
            bend_rad=0.78,
        ),
        offset_m=1.0,
        turned_rad=0.05,
    ),
    nudge(  # left-hand traffic
        "nudge/5",
        site=Site(
            map="one_north",
            lane="601020",
            at_m=90.0,
            start=LanePosition("601020", 20.0),
            goal=LanePosition("601030", 6.0),
            route=("60102", "601022", "60103"),
            driving_side="left",
            limit_mps=13.89,
            width_m=3.4,
            left_edge_m=1.7,
            right_edge_m=5.1,
            beside_start=("601020",),
            oncoming_m=3.4,
            bend_rad=0.83,
        ),
        offset_m=1.35,
    ),
    nudge(  # left-hand traffic, parked askew
        "nudge/6",
        site=Site(
            map="one_north",
            lane="401030",
            at_m=90.0,
            start=LanePosition("401030", 20.0),
            goal=LanePosition("401040", 6.0),
            route=("40103", "401032", "40104"),
            driving_side="left",
            limit_mps=13.89,
            width_m=3.6,
            left_edge_m=1.8,
            right_edge_m=8.4,
            beside_start=("401030",),
            oncoming_m=3.6,
            bend_rad=-0.76,
        ),
        offset_m=0.7,
        turned_rad=-0.08,
    ),
    nudge(  # a collector road
        "nudge/7",
        site=Site(
            map="strip",
            lane="602060",
            at_m=150.0,
            start=LanePosition("602060", 80.0),
            goal=LanePosition("602060", 230.0),
            route=("60206",),
            driving_side="right",
            limit_mps=13.33,
            width_m=3.6,
            left_edge_m=7.8,
            right_edge_m=4.2,
            beside_start=("602060",),
            oncoming_m=3.6,
            bend_rad=-0.1,
        ),
        offset_m=1.0,
    ),
    nudge(  # a delivery lorry
        "nudge/8",
        site=Site(
            map="strip",
            lane="802010",
            at_m=100.0,
            start=LanePosition("802010", 30.0),
            goal=LanePosition("802010", 180.0),
            route=("80201",),
            driving_side="right",
            limit_mps=11.11,
            width_m=3.3,
            left_edge_m=4.95,
            right_edge_m=1.65,
            beside_start=("802010",),
            oncoming_m=3.3,
            bend_rad=0.08,
        ),
        offset_m=1.25,
        kind="truck",
    ),
    nudge(  # the kerb lane of two
        "nudge/9",
        site=Site(
            map="strip",
            lane="501041",
            at_m=75.0,
            start=LanePosition("501031", 38.96),
            goal=LanePosition("501051", 6.0),
            route=("50103", "501030", "50104", "501040", "50105"),
            driving_side="right",
            limit_mps=13.33,
            width_m=3.3,
            left_edge_m=11.55,
            right_edge_m=1.65,
            beside_start=("501030", "501031"),
            lanes_left=1,
            oncoming_m=6.6,
        ),
        offset_m=1.1,
    ),
)
