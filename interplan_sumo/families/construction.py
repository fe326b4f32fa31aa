"""Construction: cones close a part or all of the ego's lane, with workers inside; leave the lane in time."""

from __future__ import annotations

from math import ceil, pi, sqrt
from typing import Final, Literal

import numpy as np

from interplan_sumo.errors import ScenarioError
from interplan_sumo.families.shapes import LARGEST_OFFSET_M, PASSING_M, start_speed_mps
from interplan_sumo.scenario.scenario import (
    OBSTACLES,
    Behaviour,
    Density,
    LanePosition,
    Obstacle,
    Scenario,
    TrafficDemand,
)
from interplan_sumo.scenario.sites import Site, UnsuitableError, roomiest_site_at
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.roads import Roads

Layout = Literal["row", "taper", "ring", "wedge"]
LAYOUTS: Final[tuple[Layout, ...]] = ("row", "taper", "ring", "wedge")
CONE_M: Final = OBSTACLES["cone"][1]
BEHIND_CONES_M: Final = 1.0
"""A worker keeps this far inside a row of cones."""
APPROACH_M: Final = (60.0, 90.0)
BEYOND_M: Final = 80.0
FASTEST_MPS: Final = 20.5
"""No works without a lowered limit on faster roads."""


def construction(
    id: str,
    *,
    site: Site,
    layout: Layout,
    cones: int,
    spacing_m: float,
    reach_m: float,
    at: Literal["kerb", "middle"] = "kerb",
    density: Density = "none",
    behaviour: Behaviour = "mixed",
) -> Scenario:
    """`cones` cones `spacing_m` apart, standing `at` one side of the lane.

    `reach_m` is how far beyond the lane's centre line, seen from their side,
    the outermost cone stands (negative: short of it). On a road with one lane
    per direction the ego must get past on its own side (decisions.md).
    """
    offset_m = reach_m + CONE_M / 2.0 + PASSING_M
    beside = site.lanes_far if at == "kerb" else site.lanes_near
    if offset_m > LARGEST_OFFSET_M and beside == 0:
        raise ScenarioError(
            f"{id}: passing the cones takes an offset of {offset_m:.2f} m and there is no lane beside; "
            f"reach_m may be at most {LARGEST_OFFSET_M - PASSING_M - CONE_M / 2.0:.2f}"
        )
    edge_m = -site.width_m / 2.0 - (site.width_m if layout == "wedge" else 0.0)
    points = np.array(_LAYOUT[layout](cones, spacing_m, edge_m, reach_m))
    points[:, 0] -= (points[:, 0].min() + points[:, 0].max()) / 2.0  # the works have the site in their middle
    away = -1.0 if at == "kerb" else 1.0  # the sign, towards the kerb, of the side on which one passes
    obstacles = [Obstacle(site.place(float(x), float(away * y)), "cone") for x, y in points]
    inside = _inside(layout, points, reach_m)
    obstacles.append(Obstacle(site.place(inside[0], away * inside[1]), "worker", turned_rad=1.6))
    return Scenario(
        id=id,
        family="construction",
        map=site.map,
        start=site.start,
        start_speed_mps=start_speed_mps(site),
        goal=site.goal,
        route=site.route,
        traffic=TrafficDemand(density=density, behaviour=behaviour),
        obstacles=tuple(obstacles),
    )


# --- where the cones stand: (ahead, beyond the lane's centre line as seen from their side) -----


def _row(cones: int, spacing_m: float, _edge_m: float, reach_m: float) -> list[tuple[float, float]]:
    return [(i * spacing_m, reach_m) for i in range(cones)]


def _taper(cones: int, spacing_m: float, edge_m: float, reach_m: float) -> list[tuple[float, float]]:
    """From the edge of the lane to the row, half of the cones in the slant."""
    slant = ceil(cones / 2)
    step_y = (reach_m - edge_m) / slant
    step_x = sqrt(max(spacing_m**2 - step_y**2, (0.5 * spacing_m) ** 2))
    points = [(i * step_x, edge_m + (i + 0.5) * step_y) for i in range(slant)]
    first_x = points[-1][0]
    return points + [(first_x + (i + 1) * spacing_m, reach_m) for i in range(cones - slant)]


def _ring(cones: int, spacing_m: float, edge_m: float, reach_m: float) -> list[tuple[float, float]]:
    """Around the closed width, evenly along an ellipse as long as the spacing makes it (circumference: pi (a + b))."""
    across_m = (reach_m - edge_m) / 2.0
    along_m = max(across_m, cones * spacing_m / pi - across_m)
    angle = np.linspace(0.0, 2.0 * pi, 721)
    x, y = along_m * np.cos(angle), (reach_m + edge_m) / 2.0 + across_m * np.sin(angle)
    arc_m = np.concatenate(([0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))))
    at_m = (np.arange(cones) + 0.5) / cones * arc_m[-1]
    return list(zip(np.interp(at_m, arc_m, x).tolist(), np.interp(at_m, arc_m, y).tolist(), strict=True))


def _wedge(cones: int, spacing_m: float, edge_m: float, reach_m: float) -> list[tuple[float, float]]:
    """Across two lanes and back."""
    out = ceil(cones / 2)
    step_y = (reach_m - edge_m) / out
    step_x = sqrt(max(spacing_m**2 - step_y**2, (0.5 * spacing_m) ** 2))
    points = [(i * step_x, edge_m + (i + 1) * step_y) for i in range(out)]
    tip_x = points[-1][0]
    back = cones - out
    return points + [
        (tip_x + (i + 1) * spacing_m, reach_m - (i + 1) * (reach_m - edge_m) / (back + 1)) for i in range(back)
    ]


def _inside(layout: Layout, points: Floats, reach_m: float) -> tuple[float, float]:
    """Where a worker stands."""
    if layout == "ring":
        x, y = points.mean(axis=0)
    elif layout == "wedge":
        x, y = points[np.argmax(points[:, 1]), 0], reach_m - 2.0 * BEHIND_CONES_M
    else:  # behind the row, or beside the straight part of the taper
        x, y = points[-1, 0] - BEHIND_CONES_M / 2.0, reach_m - BEHIND_CONES_M
    return float(x), float(y)


_LAYOUT: Final = {"row": _row, "taper": _taper, "ring": _ring, "wedge": _wedge}


# --- on any map --------------------------------------------------------------------------------


def suitable(roads: Roads, lane_id: str, at_m: float) -> Site:
    """A stretch without lights whose lane can be left, or passed on the own side; UnsuitableError otherwise."""
    site = roomiest_site_at(roads, lane_id, at_m, approach_m=APPROACH_M[1], beyond_m=BEYOND_M)
    if site.limit_mps > FASTEST_MPS:
        raise UnsuitableError(f"the limit is {site.limit_mps:.1f} m/s, works need {FASTEST_MPS} or less")
    if site.lanes_far + site.lanes_near == 0 and site.oncoming_m == 0.0:
        raise UnsuitableError("there is no lane beside it")
    return site


def drawn(id: str, site: Site, rng: np.random.Generator) -> Scenario:
    """A scenario of the family at a site, what varies drawn at random."""
    many = site.lanes_far + site.lanes_near > 0
    sides: list[Literal["kerb", "middle"]] = []
    if site.lanes_far >= 1 or not many:
        sides.append("kerb")
    if site.lanes_near >= 1:
        sides.append("middle")
    at = sides[int(rng.integers(len(sides)))]
    covered = site.lanes_near if at == "kerb" else site.lanes_far  # by a wedge, besides the ego's lane
    layouts = LAYOUTS if covered >= 1 else LAYOUTS[:-1]
    layout = layouts[int(rng.integers(len(layouts)))]
    highest_m = site.width_m / 2.0 - 0.3 if many else LARGEST_OFFSET_M - PASSING_M - CONE_M / 2.0
    return construction(
        id,
        site=site,
        layout=layout,
        cones=int(rng.integers(6 if layout in ("ring", "wedge") else 3, 9)),
        spacing_m=float(np.round(rng.uniform(1.8, 4.0), 1)),
        reach_m=float(np.round(rng.uniform(highest_m - 0.5, highest_m), 2)),
        at=at,
        density="low" if many and rng.random() < 0.5 else "none",
        behaviour=("conservative", "assertive", "mixed")[int(rng.integers(3))],
    )


# --- the ten -----------------------------------------------------------------------------------

SCENARIOS: Final[tuple[Scenario, ...]] = (
    construction(  # the middle lane of three
        "construction/0",
        site=Site(
            map="strip",
            lane="401051",
            at_m=130.0,
            start=LanePosition("401051", 40.0),
            goal=LanePosition("401051", 210.0),
            route=("40105",),
            driving_side="right",
            limit_mps=15.56,
            width_m=3.4,
            left_edge_m=5.1,
            right_edge_m=8.1,
            beside_start=("401050", "401051", "401052"),
            lanes_left=1,
            lanes_right=1,
        ),
        layout="row",
        cones=5,
        spacing_m=3.0,
        reach_m=0.9,
        at="middle",
        density="low",
        behaviour="mixed",
    ),
    construction(  # a wedge over the two lanes at the median
        "construction/1",
        site=Site(
            map="strip",
            lane="101091",
            at_m=100.0,
            start=LanePosition("101091", 10.0),
            goal=LanePosition("101091", 180.0),
            route=("10109",),
            driving_side="right",
            limit_mps=15.56,
            width_m=3.4,
            left_edge_m=5.1,
            right_edge_m=8.5,
            beside_start=("101090", "101091", "101092", "101093"),
            lanes_left=1,
            lanes_right=2,
        ),
        layout="wedge",
        cones=8,
        spacing_m=2.8,
        reach_m=1.3,
        at="middle",
    ),
    construction(  # a taper closes the kerb lane
        "construction/2",
        site=Site(
            map="strip",
            lane="402032",
            at_m=120.0,
            start=LanePosition("402032", 30.0),
            goal=LanePosition("402032", 200.0),
            route=("40203",),
            driving_side="right",
            limit_mps=15.56,
            width_m=3.4,
            left_edge_m=8.5,
            right_edge_m=1.7,
            beside_start=("402030", "402031", "402032"),
            lanes_left=2,
        ),
        layout="taper",
        cones=7,
        spacing_m=3.2,
        reach_m=1.4,
        density="low",
        behaviour="conservative",
    ),
    construction(  # a closed ring in the middle lane, left-hand traffic
        "construction/3",
        site=Site(
            map="one_north",
            lane="101051",
            at_m=150.0,
            start=LanePosition("101051", 60.0),
            goal=LanePosition("101051", 230.0),
            route=("10105",),
            driving_side="left",
            limit_mps=16.67,
            width_m=3.4,
            left_edge_m=5.1,
            right_edge_m=5.1,
            beside_start=("101050", "101051", "101052"),
            lanes_left=1,
            lanes_right=1,
            bend_rad=-0.02,
        ),
        layout="ring",
        cones=8,
        spacing_m=2.6,
        reach_m=1.4,
        density="low",
        behaviour="assertive",
    ),
    construction(  # the kerb lane of two, left-hand traffic
        "construction/4",
        site=Site(
            map="one_north",
            lane="302010",
            at_m=140.0,
            start=LanePosition("302010", 50.0),
            goal=LanePosition("302010", 220.0),
            route=("30201",),
            driving_side="left",
            limit_mps=13.89,
            width_m=3.3,
            left_edge_m=1.65,
            right_edge_m=4.95,
            beside_start=("302010", "302011"),
            lanes_right=1,
        ),
        layout="taper",
        cones=6,
        spacing_m=3.6,
        reach_m=1.3,
    ),
    construction(  # a one-way street
        "construction/5",
        site=Site(
            map="back_bay",
            lane="201020",
            at_m=120.0,
            start=LanePosition("201020", 30.0),
            goal=LanePosition("201020", 200.0),
            route=("20102",),
            driving_side="right",
            limit_mps=11.11,
            width_m=3.2,
            left_edge_m=1.6,
            right_edge_m=10.4,
            beside_start=("201020", "201021", "201022"),
            lanes_right=2,
        ),
        layout="row",
        cones=3,
        spacing_m=2.4,
        reach_m=0.6,
        at="middle",
    ),
    construction(  # a narrow two-way street, passed on the own side
        "construction/6",
        site=Site(
            map="back_bay",
            lane="301020",
            at_m=100.0,
            start=LanePosition("301020", 10.0),
            goal=LanePosition("301020", 180.0),
            route=("30102",),
            driving_side="right",
            limit_mps=8.89,
            width_m=3.1,
            left_edge_m=6.85,
            right_edge_m=3.75,
            beside_start=("301020",),
            oncoming_m=3.1,
        ),
        layout="row",
        cones=4,
        spacing_m=3.0,
        reach_m=-0.35,
    ),
    construction(  # in a bend, passed on the own side
        "construction/7",
        site=Site(
            map="hazelwood",
            lane="401040",
            at_m=100.0,
            start=LanePosition("401040", 10.0),
            goal=LanePosition("401040", 180.0),
            route=("40104",),
            driving_side="right",
            limit_mps=11.11,
            width_m=3.3,
            left_edge_m=7.15,
            right_edge_m=3.85,
            beside_start=("401040",),
            oncoming_m=3.3,
            bend_rad=-0.47,
        ),
        layout="taper",
        cones=6,
        spacing_m=2.6,
        reach_m=-0.32,
    ),
    construction(  # two-way, left-hand traffic, passed on the own side
        "construction/8",
        site=Site(
            map="one_north",
            lane="601030",
            at_m=140.0,
            start=LanePosition("601030", 50.0),
            goal=LanePosition("601030", 220.0),
            route=("60103",),
            driving_side="left",
            limit_mps=13.89,
            width_m=3.4,
            left_edge_m=1.7,
            right_edge_m=5.1,
            beside_start=("601030",),
            oncoming_m=3.4,
            bend_rad=-0.35,
        ),
        layout="taper",
        cones=8,
        spacing_m=1.6,
        reach_m=-0.5,
    ),
    construction(  # a ring in the kerb lane of two
        "construction/9",
        site=Site(
            map="back_bay",
            lane="102021",
            at_m=120.0,
            start=LanePosition("102021", 30.0),
            goal=LanePosition("102021", 200.0),
            route=("10202",),
            driving_side="right",
            limit_mps=11.11,
            width_m=3.1,
            left_edge_m=4.65,
            right_edge_m=3.75,
            beside_start=("102020", "102021"),
            lanes_left=1,
        ),
        layout="ring",
        cones=6,
        spacing_m=3.4,
        reach_m=1.2,
        density="low",
        behaviour="mixed",
    ),
)
