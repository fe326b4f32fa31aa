"""Accident: crashed cars stand at odd angles and stay; pass them with care, if need be through the oncoming lane."""

from __future__ import annotations

from typing import Final, Literal

import numpy as np

from interplan_sumo.errors import ScenarioError
from interplan_sumo.families.shapes import CLEARANCE_M, PASSING_M, reach_m, start_speed_mps
from interplan_sumo.scenario.scenario import Behaviour, Density, LanePosition, Obstacle, Scenario, TrafficDemand
from interplan_sumo.scenario.sites import Site, UnsuitableError, roomiest_site_at
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.roads import Roads

Crash = Literal["rear_end", "t_bone", "side_swipe", "pile_up"]
CRASHES: Final[dict[Crash, tuple[tuple[float, float, float], ...]]] = {
    "rear_end": ((0.0, 0.0, 0.15), (-4.2, -0.35, -0.3)),
    "t_bone": ((0.0, 0.0, 1.35), (-2.85, 0.25, -0.1)),
    "side_swipe": ((0.0, 0.0, 0.05), (1.3, 1.55, 0.4)),
    "pile_up": ((0.0, 0.0, 0.2), (-4.2, -0.3, -0.25), (-7.8, 0.7, 0.6)),
}
"""Each car's place relative to the first, ahead and towards the kerb (m), and its heading relative to the lane, turned
towards the kerb (rad). The boxes of neighbours intersect."""
APPROACH_M: Final = 70.0
BEYOND_M: Final = 80.0
FASTEST_MPS: Final = 20.5
ROOM_M: Final = PACIFICA.width_m + 2.0 * CLEARANCE_M
"""What must be left of the road."""


def accident(
    id: str,
    *,
    site: Site,
    crash: Crash,
    towards_kerb_m: float,
    turned_rad: float = 0.0,
    mirrored: bool = False,
    density: Density = "none",
    oncoming: Density = "none",
    behaviour: Behaviour = "mixed",
) -> Scenario:
    """A `crash` whose first car stands `towards_kerb_m` off the lane's centre line.

    `turned_rad` turns all of it towards the kerb, `mirrored` swaps its sides.
    ScenarioError if the road leaves less than the ego's width and 0.3 m on
    either side.
    """
    flip = -1.0 if mirrored else 1.0
    cosine, sine = np.cos(turned_rad), np.sin(turned_rad)
    cars: list[Obstacle] = []
    for ahead_m, kerbwards_m, heading_rad in CRASHES[crash]:
        across_m, heading_rad = flip * kerbwards_m, flip * heading_rad + turned_rad
        x_m = float(cosine * ahead_m - sine * across_m)
        y_m = float(sine * ahead_m + cosine * across_m)
        cars.append(
            Obstacle(site.place(x_m, towards_kerb_m + y_m), "car", turned_rad=round(float(site.kerb * heading_rad), 3))
        )
    to_kerb_m, away_m = reach_m(cars, site.kerb)
    left_m = max(site.far_edge_m - away_m, site.near_edge_m - to_kerb_m)
    if left_m < ROOM_M:
        raise ScenarioError(
            f"{id}: the crash leaves {left_m:.2f} m of the road, the ego needs {ROOM_M:.2f} m; "
            "move it with towards_kerb_m"
        )
    return Scenario(
        id=id,
        family="accident",
        map=site.map,
        start=site.start,
        start_speed_mps=start_speed_mps(site),
        goal=site.goal,
        route=site.route,
        traffic=TrafficDemand(density=density, behaviour=behaviour, oncoming=oncoming),
        obstacles=tuple(cars),
        exempt=("driving_direction",),
    )


def suitable(roads: Roads, lane_id: str, at_m: float) -> Site:
    """A road with a second lane to pass on, of whatever direction; UnsuitableError otherwise."""
    site = roomiest_site_at(roads, lane_id, at_m, approach_m=APPROACH_M, beyond_m=BEYOND_M)
    if site.limit_mps > FASTEST_MPS:
        raise UnsuitableError(f"the limit is {site.limit_mps:.1f} m/s, crashes stand on roads of {FASTEST_MPS} or less")
    if site.lanes_far + site.lanes_near == 0 and site.oncoming_m < PACIFICA.width_m:
        raise UnsuitableError("there is no lane beside it to pass on")
    return site


def drawn(id: str, site: Site, rng: np.random.Generator) -> Scenario:
    """A scenario of the family at a site, what varies drawn; UnsuitableError if no crash leaves room."""
    many = site.lanes_far + site.lanes_near > 0
    for _ in range(50):
        try:
            return accident(
                id,
                site=site,
                crash=tuple(CRASHES)[int(rng.integers(len(CRASHES)))],
                towards_kerb_m=float(np.round(rng.uniform(-1.0, 1.5), 2)),
                turned_rad=float(np.round(rng.uniform(-0.5, 0.5), 2)),
                mirrored=bool(rng.random() < 0.5),
                density="low" if many and rng.random() < 0.3 else "none",
                oncoming="low" if not many and rng.random() < 0.3 else "none",
                behaviour=("conservative", "assertive", "mixed")[int(rng.integers(3))],
            )
        except ScenarioError:
            continue
    raise UnsuitableError("no crash leaves room to pass")


def blocks_lane(site: Site, scenario: Scenario) -> bool:
    """Whether a car that keeps to the lane's centre line would touch the crash, with clearance."""
    to_kerb_m, away_m = reach_m(scenario.obstacles, site.kerb)
    return away_m > -PASSING_M and to_kerb_m > -PASSING_M


# --- the ten -----------------------------------------------------------------------------------

SCENARIOS: Final[tuple[Scenario, ...]] = (
    accident(  # a side street car hit square, in a bend
        "accident/0",
        site=Site(
            map="hazelwood",
            lane="401030",
            at_m=160.0,
            start=LanePosition("401030", 90.0),
            goal=LanePosition("401040", 12.42),
            route=("40103", "401032", "40104"),
            driving_side="right",
            limit_mps=11.11,
            width_m=3.3,
            left_edge_m=7.15,
            right_edge_m=3.85,
            beside_start=("401030",),
            oncoming_m=3.3,
            bend_rad=-0.25,
        ),
        crash="t_bone",
        towards_kerb_m=0.3,
        turned_rad=0.2,
    ),
    accident(  # a narrow two-way street
        "accident/1",
        site=Site(
            map="back_bay",
            lane="302020",
            at_m=105.0,
            start=LanePosition("302020", 35.0),
            goal=LanePosition("302020", 185.0),
            route=("30202",),
            driving_side="right",
            limit_mps=8.89,
            width_m=3.1,
            left_edge_m=6.85,
            right_edge_m=3.75,
            beside_start=("302020",),
            oncoming_m=3.1,
        ),
        crash="rear_end",
        towards_kerb_m=0.0,
        turned_rad=-0.1,
    ),
    accident(  # left-hand traffic, in a bend
        "accident/2",
        site=Site(
            map="one_north",
            lane="501010",
            at_m=95.0,
            start=LanePosition("501010", 25.0),
            goal=LanePosition("501020", 6.0),
            route=("50101", "501010", "50102"),
            driving_side="left",
            limit_mps=11.11,
            width_m=3.3,
            left_edge_m=1.65,
            right_edge_m=7.35,
            beside_start=("501010",),
            oncoming_m=3.3,
            bend_rad=0.78,
        ),
        crash="side_swipe",
        towards_kerb_m=-0.4,
        turned_rad=0.3,
    ),
    accident(  # three cars on a two-way road
        "accident/3",
        site=Site(
            map="strip",
            lane="701010",
            at_m=150.0,
            start=LanePosition("701010", 80.0),
            goal=LanePosition("701010", 230.0),
            route=("70101",),
            driving_side="right",
            limit_mps=13.33,
            width_m=3.5,
            left_edge_m=5.25,
            right_edge_m=1.75,
            beside_start=("701010",),
            oncoming_m=3.5,
            bend_rad=0.29,
        ),
        crash="pile_up",
        towards_kerb_m=0.4,
    ),
    accident(  # left-hand traffic, cars coming towards
        "accident/4",
        site=Site(
            map="one_north",
            lane="602020",
            at_m=130.0,
            start=LanePosition("602020", 60.0),
            goal=LanePosition("602020", 210.0),
            route=("60202",),
            driving_side="left",
            limit_mps=13.89,
            width_m=3.4,
            left_edge_m=1.7,
            right_edge_m=5.1,
            beside_start=("602020",),
            oncoming_m=3.4,
            bend_rad=0.43,
        ),
        crash="t_bone",
        towards_kerb_m=0.4,
        mirrored=True,
        oncoming="low",
        behaviour="conservative",
    ),
    accident(  # across the lane, cars coming towards
        "accident/5",
        site=Site(
            map="strip",
            lane="601040",
            at_m=150.0,
            start=LanePosition("601040", 80.0),
            goal=LanePosition("601040", 230.0),
            route=("60104",),
            driving_side="right",
            limit_mps=13.33,
            width_m=3.6,
            left_edge_m=7.8,
            right_edge_m=4.2,
            beside_start=("601040",),
            oncoming_m=3.6,
        ),
        crash="rear_end",
        towards_kerb_m=0.7,
        turned_rad=0.2,
        oncoming="low",
        behaviour="mixed",
    ),
    accident(  # the middle lane of three, traffic around
        "accident/6",
        site=Site(
            map="strip",
            lane="402051",
            at_m=100.0,
            start=LanePosition("402051", 30.0),
            goal=LanePosition("402051", 180.0),
            route=("40205",),
            driving_side="right",
            limit_mps=15.56,
            width_m=3.4,
            left_edge_m=5.1,
            right_edge_m=5.1,
            beside_start=("402050", "402051", "402052"),
            lanes_left=1,
            lanes_right=1,
            bend_rad=-0.01,
        ),
        crash="pile_up",
        towards_kerb_m=0.0,
        density="low",
        behaviour="assertive",
    ),
    accident(  # the middle lane of three, left-hand traffic
        "accident/7",
        site=Site(
            map="one_north",
            lane="102031",
            at_m=130.0,
            start=LanePosition("102031", 60.0),
            goal=LanePosition("102031", 210.0),
            route=("10203",),
            driving_side="left",
            limit_mps=16.67,
            width_m=3.4,
            left_edge_m=6.96,
            right_edge_m=5.1,
            beside_start=("102030", "102031", "102032"),
            lanes_left=1,
            lanes_right=1,
        ),
        crash="t_bone",
        towards_kerb_m=0.3,
        density="low",
        behaviour="assertive",
    ),
    accident(  # the kerb lane of two
        "accident/8",
        site=Site(
            map="back_bay",
            lane="101031",
            at_m=95.0,
            start=LanePosition("101031", 25.0),
            goal=LanePosition("101031", 175.0),
            route=("10103",),
            driving_side="right",
            limit_mps=11.11,
            width_m=3.1,
            left_edge_m=4.65,
            right_edge_m=3.75,
            beside_start=("101030", "101031"),
            lanes_left=1,
        ),
        crash="side_swipe",
        towards_kerb_m=0.2,
    ),
    accident(  # in a sharp bend
        "accident/9",
        site=Site(
            map="hazelwood",
            lane="421020",
            at_m=110.0,
            start=LanePosition("421020", 40.0),
            goal=LanePosition("421020", 190.0),
            route=("42102",),
            driving_side="right",
            limit_mps=11.11,
            width_m=3.3,
            left_edge_m=4.95,
            right_edge_m=1.65,
            beside_start=("421020",),
            oncoming_m=3.3,
            bend_rad=0.83,
        ),
        crash="rear_end",
        towards_kerb_m=0.2,
        turned_rad=0.12,
    ),
)
