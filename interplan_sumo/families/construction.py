"""Construction: cones close a part or all of the lane, with workers inside."""

from __future__ import annotations

from functools import partial
from math import ceil, pi, sqrt
from typing import Final, Literal

import numpy as np

from interplan_sumo.errors import ScenarioError
from interplan_sumo.families.family import Family
from interplan_sumo.families.passing import passing_problems
from interplan_sumo.families.shapes import LARGEST_OFFSET_M, NO_TRAFFIC, PASSING_M
from interplan_sumo.scenario.scenario import OBSTACLES, Obstacle, Scenario, TrafficDemand
from interplan_sumo.scenario.sites import Site, UnsuitableError, roomiest_site_at
from interplan_sumo.world.actors import ActorKind
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
    traffic: TrafficDemand = NO_TRAFFIC,
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
    return site.scenario(id, "construction", traffic=traffic, obstacles=tuple(obstacles))


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


def drawn(id: str, _roads: Roads, site: Site, rng: np.random.Generator) -> Scenario:
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
        traffic=TrafficDemand(
            density="low" if many and rng.random() < 0.5 else "none",
            behaviour=("conservative", "assertive", "mixed")[int(rng.integers(3))],
        ),
    )


def asks(scenario: Scenario, _roads: Roads) -> bool:
    """Whether cones or barriers stand somewhere."""
    return any(OBSTACLES[each.kind][0] in (ActorKind.TRAFFIC_CONE, ActorKind.BARRIER) for each in scenario.obstacles)


FAMILY: Final = Family(
    title="Construction",
    description="Cones close a part or all of the ego's lane, with workers inside; leave the lane in time.",
    suitable=suitable,
    drawn=drawn,
    order=10,
    column="Constr.",
    checks=(partial(passing_problems, own_side_only=True),),
    weighs_direction=True,
    asks=asks,
    original="approaching_construction_zone",
)
