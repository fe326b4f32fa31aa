"""Charts: the signals behind the score, frame by frame, with the limits that they are held against."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import shapely

from interplan_sumo.metrics.comfort import BOUNDS
from interplan_sumo.metrics.drivable_area import TOLERANCE_M
from interplan_sumo.metrics.facts import Facts
from interplan_sumo.metrics.score import ScoreSheet
from interplan_sumo.metrics.speed_limit import limits_mps
from interplan_sumo.metrics.time_to_collision import LEAST_S, time_to_collision
from interplan_sumo.report.replay.numbers import series
from interplan_sumo.world.geometry import Floats


@dataclass(frozen=True, slots=True)
class Chart:
    """What one chart shows; the same for every drive of a page."""

    key: str
    title: str
    unit: str
    metric: str = ""
    """The metric that is judged by it."""
    limits: tuple[float, ...] = ()
    """Horizontal lines not to be crossed: the lower one, and the upper one where there is one."""
    shown: tuple[float | None, float | None] = (None, None)
    """Least and greatest value of the axis; None leaves it to the values."""
    about: str = ""


def _bounded(signal: str, title: str, unit: str) -> Chart:
    return Chart(signal, title, unit, "comfort", BOUNDS[signal], about="red: limits of comfort")


CHARTS: Final = (
    Chart("speed", "Speed", "m/s", "speed_limit", shown=(0.0, None), about="dashed: the limit"),
    _bounded("longitudinal_acceleration_mps2", "Acceleration", "m/s²"),
    _bounded("longitudinal_jerk_mps3", "Jerk", "m/s³"),
    Chart("time_to_collision", "Time to collision", "s", "time_to_collision", (LEAST_S,), (0.0, 3.0),
          "if everybody went straight on"),
    Chart("progress", "Progress", "m", "progress", shown=(0.0, None), about="along the route, dashed: the expert's"),
    Chart("edge", "Distance to the road's edge", "m", "drivable_area", (-TOLERANCE_M,), (None, 4.0),
          "of the nearest corner, negative beyond the edge"),
    Chart("offset", "Lane offset", "m", about="from its centre line, left positive"),
    Chart("distance", "Nearest road user or object", "m", shown=(0.0, 30.0), about="between the boxes"),
    _bounded("lateral_acceleration_mps2", "Lateral acceleration", "m/s²"),
    _bounded("jerk_mps3", "Total jerk", "m/s³"),
    _bounded("yaw_rate_radps", "Yaw rate", "rad/s"),
    _bounded("yaw_acceleration_radps2", "Yaw acceleration", "rad/s²"),
)  # fmt: skip


def chart_series(facts: Facts, sheet: ScoreSheet, drivable: shapely.Geometry) -> dict[str, dict[str, Any]]:
    """Of each chart the `values` per frame, and under `beside` what they are compared with, where there is such.

    `drivable` is the drivable area around the drive.
    """
    told = sheet.metrics["diagnostics"].series
    ahead = sheet.metrics.get("time_to_collision") or time_to_collision(facts)
    start_m = facts.route_arc_m[:1]
    own: dict[str, Floats] = {
        "speed": facts.speed_mps,
        "time_to_collision": ahead.series["time_to_collision_s"],
        "progress": facts.route_arc_m - start_m,
        "edge": edge_m(facts, drivable),
        "offset": told["offset_m"],
        "distance": told["distance_m"],
        **facts.comfort_signals,
    }
    beside = {"speed": limits_mps(facts), "progress": _expert_m(facts) - start_m}
    nothing = np.full(facts.frames, np.nan)
    return {
        chart.key: {"values": series(own.get(chart.key, nothing))}
        | ({"beside": series(beside[chart.key])} if chart.key in beside else {})
        for chart in CHARTS
    }


def edge_m(facts: Facts, drivable: shapely.Geometry) -> Floats:
    """(N,) distance of the corner that is nearest to the edge of the drivable area; negative where one is beyond.

    Not a number where there is no such area. What is beyond agrees with the
    metric: a corner in a lane is inside, whatever the surfaces say.
    """
    if shapely.is_empty(drivable):
        return np.full(facts.frames, np.nan)
    to_edge = shapely.distance(shapely.points(facts.corners), shapely.boundary(drivable))
    outside = np.array([[not place for place in corners] for corners in facts.corner_places], dtype=np.bool_)
    outside = outside.reshape(-1, 4) & ~shapely.contains_xy(drivable, facts.corners[..., 0], facts.corners[..., 1])
    return np.where(outside, -to_edge, to_edge).min(axis=1)


def _expert_m(facts: Facts) -> Floats:
    """(N,) where the expert is along the route at the time of each frame; it stays where it ends."""
    if not len(facts.expert):
        return np.full(facts.frames, np.nan)
    since_s = (facts.expert.time_us - facts.expert.time_us[0]) * 1e-6
    return np.interp(facts.time_s, since_s, facts.expert_route_arc_m)
