"""Drawings of an endurance report as figures of SVG: rates over densities, where things happened, and widths."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import asinh, ceil, floor, log10
from typing import Final

import numpy as np

from interplan_sumo.endurance.formats import number_text, range_text
from interplan_sumo.endurance.rate_sample import MEASURES, MeasureKey
from interplan_sumo.endurance.rates import DrivenRates
from interplan_sumo.endurance.report import EnduranceReport, MappedEvent
from interplan_sumo.errors import InputError
from interplan_sumo.maps.store import load_roads
from interplan_sumo.report.page.curves import (
    HIGH,
    LEFT,
    WIDE,
    CurveMark,
    CurvePanel,
    PlannerCurve,
    aside,
    bar_between,
    height,
    line_through,
    place_along,
)
from interplan_sumo.report.page.html import COLOURS
from interplan_sumo.world.geometry import Floats

DETAIL_M: Final = 2.0
"""Of roads on the map of events."""
MAP_WIDE: Final = 1000.0
"""Of the map, in its own units."""
ON_MAP: Final[tuple[MeasureKey, ...]] = (
    "at_fault_collision", "other_collision", "near_miss", "hard_braking", "red_light", "stall", "off_road",
)  # fmt: skip
"""In the order of their colours; the first is drawn on top."""


@dataclass(frozen=True, slots=True)
class EventMap:
    """A district and what happened where."""

    name: str
    high: float
    roads: str
    dots: tuple[tuple[float, float, int, str], ...]
    """Place, colour and what it is."""
    counts: tuple[tuple[int, str], ...]
    """Colours, and how many of what."""


def planner_colours(report: EnduranceReport) -> dict[str, int]:
    """By planner; see COLOURS."""
    return {each.planner: number % COLOURS for number, each in enumerate(report.rates.planners)}


def rate_drawings(report: EnduranceReport) -> list[CurvePanel]:
    """A panel for each population of drivers on each map: the rate over densities, a line being the regression's."""
    cells = [each for each in report.rates.cells if each.cell is not None and each.measures]
    panels = dict.fromkeys((each.cell.map, each.cell.drivers) for each in cells if each.cell)
    densities = sorted({each.cell.density for each in cells if each.cell})
    axis = RateAxis.of(cells, report)
    found: list[CurvePanel] = []
    for map_name, drivers in panels:
        own = [each for each in cells if each.cell and (each.cell.map, each.cell.drivers) == (map_name, drivers)]
        found.append(
            CurvePanel(
                title=f"{drivers}, {map_name}",
                planners=tuple(_drawn(name, own, densities, axis, report) for name in dict.fromkeys(_names(own))),
                along=tuple((place_along(n, len(densities)), f"{value:g}") for n, value in enumerate(densities)),
                upwards=tuple((axis.y(rate), number_text(rate)) for rate in axis.marked),
                axis="density, of saturation",
                about="; ".join(
                    f"{each.label}: {number_text(each.measures[report.measure].total.per_1000_km)}" for each in own
                ),
            )
        )
    return found


def _names(cells: Iterable[DrivenRates]) -> list[str]:
    return [each.planner for each in cells]


def _highest(driven: DrivenRates, report: EnduranceReport) -> float:
    """What has to fit: an interval, but no more than four times the rate."""
    rate = driven.measures[report.measure].total
    high = rate.per_1000_km if rate.interval is None else min(rate.interval[1], 4.0 * rate.per_1000_km)
    fitted = None if driven.cell is None else report.regression.fitted.get((driven.planner, driven.cell))
    return max(high, 0.0 if fitted is None else min(fitted[1][1], 2.0 * fitted[0]))


def _drawn(
    name: str, cells: Sequence[DrivenRates], densities: Sequence[float], axis: RateAxis, report: EnduranceReport
) -> PlannerCurve:
    planners = list(planner_colours(report))
    beside = aside(planners.index(name), len(planners))
    marks: list[CurveMark] = []
    line: list[tuple[float, float, float, float]] = []
    own = [(each.cell, each) for each in cells if each.cell is not None and each.planner == name]
    for cell, each in sorted(own, key=lambda pair: pair[0]):
        x = place_along(densities.index(cell.density), len(densities)) + beside
        rate = each.measures[report.measure].total
        bar = ""
        if rate.interval is not None:
            bar = bar_between(x, *map(axis.y, rate.interval))
        said = f"({rate.events} events)" if rate.interval is None else range_text(rate.interval)
        title = f"{each.label}: {number_text(rate.per_1000_km)} {said}"
        marks.append(CurveMark(round(x, 1), round(axis.y(rate.per_1000_km), 1), bar, not bar, title))
        fitted = report.regression.fitted.get((name, cell))
        if fitted is not None:
            centre, (low, high) = fitted
            line.append((x, axis.y(centre), axis.y(low), axis.y(high)))
    path = line_through([(x, y) for x, y, _, _ in line])
    band = line_through([*((x, low) for x, _, low, _ in line), *((x, high) for x, _, _, high in line[::-1])])
    return PlannerCurve(name, planner_colours(report)[name], path, band, tuple(marks))


@dataclass(frozen=True, slots=True)
class RateAxis:
    """Rates differ by powers of ten, and some are 0: even up to about `least`, logarithmic beyond it, up to `top`."""

    least: float
    top: float

    @classmethod
    def of(cls, cells: Sequence[DrivenRates], report: EnduranceReport) -> RateAxis:
        """From the power of ten below all rates that are not 0, 1 at least, to a round number above all."""
        rates = [each.measures[report.measure].total.per_1000_km for each in cells]
        lowest = min((rate for rate in rates if rate > 0.0), default=1.0)
        return cls(10.0 ** max(floor(log10(lowest)), 0), axis_top(_highest(each, report) for each in cells))

    def y(self, rate: float) -> float:
        """Of a rate in a panel."""
        return height(asinh(rate / self.least), 0.0, asinh(self.top / self.least))

    @property
    def marked(self) -> list[float]:
        """The rates that have a mark: 0 and the powers of ten, or quarters where there is hardly one."""
        decades = [self.least * 10.0**n for n in range(floor(log10(self.top / self.least)) + 1)]
        return [0.0, *decades] if len(decades) > 1 else [self.top * n / 4.0 for n in range(5)]


def axis_top(values: Iterable[float]) -> float:
    """The least of 1, 2, 5, 10, ... times four ticks that all of these are below."""
    highest = max([0.0, *values]) or 1.0
    size = 10.0 ** floor(log10(highest / 4.0))
    return 4.0 * next(step * size for step in (1.0, 2.0, 2.5, 5.0, 10.0) if 4.0 * step * size >= highest)


def width_drawing(report: EnduranceReport) -> CurvePanel | None:
    """Kilometres against the half-width of the interval, both on logarithmic scales; None without any interval."""
    lines = {planner: points for planner, points in report.widths.items() if points}
    if not lines:
        return None
    every = [point for points in lines.values() for point in points]
    low_km, high_km = _decades([each.km for each in every])
    low, high = 0.05, 1.0
    drawn: list[PlannerCurve] = []
    for planner, points in lines.items():
        places = [(_log_x(each.km, low_km, high_km), _log_y(each.half_width, low, high)) for each in points]
        marks = tuple(
            CurveMark(x, y, "", False, f"{planner}, {number_text(each.km)} km: +-{100.0 * each.half_width:.0f} %")
            for (x, y), each in zip(places, points, strict=True)
        )
        drawn.append(PlannerCurve(planner, planner_colours(report)[planner], line_through(places), "", marks))
    decades = [10.0**power for power in range(round(log10(low_km)), round(log10(high_km)) + 1)]
    return CurvePanel(
        title="Half of the 95 % interval over the rate",
        planners=tuple(drawn),
        along=tuple((_log_x(km, low_km, high_km), number_text(km)) for km in decades),
        upwards=tuple(
            (_log_y(value, low, high), f"{100.0 * value:.0f} %") for value in (0.05, 0.1, 0.2, 0.3, 0.5, 1.0)
        ),
        axis="kilometres driven",
        about="; ".join(f"{name}: +-{100.0 * points[-1].half_width:.0f} %" for name, points in lines.items()),
    )


def _decades(values: Sequence[float]) -> tuple[float, float]:
    low, high = floor(log10(min(values))), ceil(log10(max(values)))
    return 10.0**low, 10.0 ** max(high, low + 1)


def _log_x(value: float, low: float, high: float) -> float:
    return round(LEFT + 8.0 + (WIDE - LEFT - 16.0) * log10(value / low) / log10(high / low), 1)


def _log_y(value: float, low: float, high: float) -> float:
    return round(HIGH * (1.0 - log10(min(max(value, low), high) / low) / log10(high / low)), 1)


def event_maps(report: EnduranceReport) -> list[EventMap]:
    """A map of each district, with its roads where they can be read."""
    return [_event_map(name, events) for name, events in report.events.items() if events]


def _event_map(name: str, events: Sequence[MappedEvent]) -> EventMap:
    lines = road_lines(name)
    places = np.array([(each.event.x, each.event.y) for each in events], dtype=np.float64)
    every = np.concatenate([places, *lines])
    low, size = every.min(axis=0), np.maximum(np.ptp(every, axis=0), 1.0)
    scale = MAP_WIDE / size[0]
    if scale * size[1] > MAP_WIDE:
        scale = MAP_WIDE / size[1]

    def drawn(points: Floats) -> Floats:
        found = np.empty_like(points)
        found[:, 0] = points[:, 0] - low[0]
        found[:, 1] = low[1] + size[1] - points[:, 1]
        return np.round(found * scale, 1)

    ordered = sorted(zip(events, drawn(places).tolist(), strict=True), key=lambda each: -ON_MAP.index(each[0].measure))
    found: dict[MeasureKey, int] = {key: sum(each.measure == key for each in events) for key in ON_MAP}
    return EventMap(
        name=name,
        high=round(float(size[1]) * scale, 1),
        roads="".join("M" + "L".join(f"{x:g} {y:g}" for x, y in drawn(line).tolist()) for line in lines),
        dots=tuple((x, y, ON_MAP.index(each.measure), event_text(each)) for each, (x, y) in ordered),
        counts=tuple((ON_MAP.index(key), f"{MEASURES[key]}: {count}") for key, count in found.items() if count),
    )


def road_lines(name: str) -> list[Floats]:
    """Centre lines (N, 2) of a map's lanes, thinned; none where there is no such map any more."""
    import shapely

    try:
        roads = load_roads(name)
    except InputError:
        return []
    lines = [lane.centerline.linestring for lane in (*roads.lanes.values(), *roads.connectors.values())]
    return [shapely.get_coordinates(line) for line in shapely.simplify(np.array(lines, dtype=object), DETAIL_M)]


def event_text(each: MappedEvent) -> str:
    """What happened, in a line."""
    event = each.event
    other = f" with {event.other}" if event.other else ""
    rare = f", {event.rare.replace('_', ' ')}" if event.rare else ""
    return (
        f"{each.planner}: {MEASURES[each.measure]}{other}{rare}, {event.place}, "
        f"segment {each.segment} at {event.time_s:.0f} s"
    )
