"""Construction: cones close a part or all of the lane, workers inside; shapes as published, tapers by the rules."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from math import ceil, pi, sqrt
from typing import Any, Final, Literal

import numpy as np

from interplan_sumo.families.draws import Draws
from interplan_sumo.families.family import Family
from interplan_sumo.families.passing import passing_problems
from interplan_sumo.families.shapes import LARGEST_OFFSET_M, PASSING_M
from interplan_sumo.families.staging import (
    Approach,
    along,
    approach,
    beside_traffic,
    oncoming_traffic,
    site_for,
)
from interplan_sumo.scenario.kinds import OBSTACLES
from interplan_sumo.scenario.scenario import Obstacle, Scenario
from interplan_sumo.scenario.sites import Site, UnsuitableError
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.roads import Roads

Layout = Literal["row", "taper", "ring", "wedge", "closure", "narrowing"]
At = Literal["kerb", "middle"]
PUBLISHED: Final[tuple[Layout, ...]] = ("row", "taper", "ring", "wedge")
"""interPlan's shapes: 3 to 8 cones, 1.6 to 4.4 m apart."""
CONES: Final[dict[Layout, tuple[int, int]]] = {"row": (3, 5), "taper": (5, 8), "ring": (7, 9), "wedge": (6, 8)}
SPACING_M: Final = (1.6, 4.4)
CLOSURE_SHARE: Final = 0.5
"""Of the works on roads with a lane beside that close the lane with a taper by the rules."""
NARROWING_SHARE: Final = 0.6
"""Of those on roads without one that leave the ego a part of the oncoming lane."""
TAPER_DIVISOR: Final = 155.0
"""A merging taper is W S^2 / 155 long (W in m, S in km/h: MUTCD 2009, table 6C-4, below 70 km/h);"""
SHORT_TAPER_M: Final = 15.0
"""where two directions share a lane 15 to 30 m (section 6C.08)."""
LONGEST_TAPER_M: Final = 60.0
CONE_EVERY_S: Final = 0.7
"""Cones of a taper stand as many feet apart as the limit has miles per hour (section 6C.08): 0.7 s at that speed."""
WORKS_M: Final = (12.0, 30.0)
"""Behind the taper."""
JITTER_M: Final = 0.12
CONE_M: Final = OBSTACLES["cone"][1]
BEHIND_CONES_M: Final = 1.0
"""A worker keeps this far inside a row of cones."""
WORKERS: Final = (1, 2)
FASTEST_MPS: Final = 20.5
"""No works without a lowered limit on faster roads."""


@dataclass(frozen=True, slots=True)
class Works:
    """What stands where: (ahead of the first, beyond the lane's centre line as seen from the works' side)."""

    cones: Floats
    """(N, 2)"""
    workers: tuple[tuple[float, float], ...]

    @property
    def length_m(self) -> float:
        return float(self.cones[:, 0].max())


def works(layout: Layout, site: Site, reach_m: float, draws: Draws) -> Works:
    """Works of a layout; `reach_m` is how far beyond the lane's centre line the outermost cone stands."""
    if layout in ("closure", "narrowing"):
        return _by_the_rules(layout, site, reach_m, draws)
    cones = draws.whole("cones", CONES[layout])
    edge_m = -site.width_m / 2.0 - (site.width_m if layout == "wedge" else 0.0)
    points = np.array(_LAYOUT[layout](cones, draws.uniform("cone_spacing_m", SPACING_M), edge_m, reach_m))
    points[:, 0] -= points[:, 0].min()
    return Works(points, (_inside(layout, points, reach_m),))


def _by_the_rules(layout: Layout, site: Site, reach_m: float, draws: Draws) -> Works:
    """A taper from the lane's edge, then a straight row beside the works, with workers inside."""
    edge_m = -site.width_m / 2.0
    across_m, spacing_m = reach_m - edge_m, CONE_EVERY_S * site.limit_mps
    taper_m = min(LONGEST_TAPER_M, across_m * (3.6 * site.limit_mps) ** 2 / TAPER_DIVISOR)
    if layout == "narrowing":
        taper_m, spacing_m = SHORT_TAPER_M, SHORT_TAPER_M / 5.0
    works_m = draws.uniform("works_m", WORKS_M, 1)
    many = max(4, ceil(taper_m / spacing_m) + 1)
    share = np.linspace(0.0, 1.0, many)
    taper = np.stack((share * taper_m, edge_m + share * across_m), axis=1)
    row_m = np.arange(spacing_m, works_m + 0.1, min(spacing_m, 6.0))
    row = np.stack((taper_m + row_m, np.full_like(row_m, reach_m)), axis=1)
    points = np.concatenate((taper, row))
    points[:, 1] -= np.abs(draws.scatter((0.0, JITTER_M), len(points)))
    many = draws.whole("workers", WORKERS)
    at_m = [taper_m + works_m * draws.uniform("worker_at_share", (0.1, 0.9)) for _ in range(many)]
    workers = [(each_m, reach_m - BEHIND_CONES_M - draws.uniform("worker_inside_m", (0.0, 0.3))) for each_m in at_m]
    apart = workers[:1] + [each for each in workers[1:] if abs(each[0] - workers[0][0]) > 1.3]
    return Works(points, tuple(apart))


def construction(id: str, roads: Roads, to: Approach, at: At, made: Works, staged: dict[str, Any]) -> Scenario:
    """Works `at` one side of the lane, with the site in their middle; ScenarioError if the road ends before they do."""
    away = -1.0 if at == "kerb" else 1.0  # the sign, towards the kerb, of the side on which one passes
    half_m = made.length_m / 2.0
    things: list[Obstacle] = []
    for x, y in made.cones.tolist():
        things.append(Obstacle(along(roads, to.site, x - half_m, away * y), "cone"))
    for x, y in made.workers:
        things.append(Obstacle(along(roads, to.site, x - half_m, away * y), "worker", turned_rad=1.6))
    return to.scenario(id, "construction", obstacles=tuple(things), **staged)


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


_LAYOUT: Final[dict[str, Any]] = {"row": _row, "taper": _taper, "ring": _ring, "wedge": _wedge}


# --- on any map --------------------------------------------------------------------------------


def suitable(roads: Roads, lane_id: str, at_m: float) -> Site:
    """A stretch without lights whose lane can be left, or passed on the own side; UnsuitableError otherwise."""
    site = site_for(roads, lane_id, at_m, FASTEST_MPS)
    if site.lanes_far + site.lanes_near == 0 and site.oncoming_m == 0.0:
        raise UnsuitableError("there is no lane beside it")
    return site


def drawn(id: str, roads: Roads, site: Site, draws: Draws) -> Scenario:
    """A scenario of the family at a site, what varies drawn at random."""
    many = site.lanes_far + site.lanes_near > 0
    sides: list[At] = []
    if site.lanes_far >= 1 or not many:
        sides.append("kerb")
    if site.lanes_near >= 1:
        sides.append("middle")
    at = draws.one_of("side", sides)
    covered = site.lanes_near if at == "kerb" else site.lanes_far  # by a wedge, besides the ego's lane
    layout = _drawn_layout(many, covered >= 1, draws)
    # with no lane beside the ego gets past on its own side (decisions.md)
    highest_m = site.width_m / 2.0 - 0.3 if many else LARGEST_OFFSET_M - PASSING_M - CONE_M / 2.0
    lowest_m = highest_m - (0.15 if layout in ("closure", "narrowing") else 0.5)
    made = works(layout, site, draws.uniform("reach_m", (lowest_m, highest_m)), draws)
    to = approach(roads, site, draws, before_m=made.length_m / 2.0, after_m=made.length_m / 2.0)
    if many:
        return construction(id, roads, to, at, made, beside_traffic(roads, to, draws, towards_kerb=at == "middle"))
    return construction(id, roads, to, at, made, oncoming_traffic(roads, to, draws))


def _drawn_layout(many: bool, wide: bool, draws: Draws) -> Layout:
    if many and draws.happens("closure", CLOSURE_SHARE):
        return "closure"
    if not many and draws.happens("narrowing", NARROWING_SHARE):
        return "narrowing"
    layouts = PUBLISHED if wide else PUBLISHED[:-1]
    return draws.one_of("layout", layouts)


def asks(scenario: Scenario, _roads: Roads) -> bool:
    """Whether cones or barriers stand somewhere."""
    return any(OBSTACLES[each.kind][0] in (ActorKind.TRAFFIC_CONE, ActorKind.BARRIER) for each in scenario.obstacles)


FAMILY: Final = Family(
    title="Construction",
    description="Cones close a part or all of the ego's lane, with workers inside; leave the lane in time.",
    suitable=suitable,
    drawn=drawn,
    telling=("reach_m", "start_speed_share"),
    order=10,
    column="Constr.",
    checks=(partial(passing_problems, own_side_only=True),),
    weighs_direction=True,
    asks=asks,
    original="approaching_construction_zone",
)
