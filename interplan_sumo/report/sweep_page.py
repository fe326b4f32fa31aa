"""Sweep page: curves of each planner over a parameter, by how much it falls, and the table, as one HTML file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from interplan_sumo.batch.sweep import Parameter
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
from interplan_sumo.report.page.html import COLOURS, html, style_of
from interplan_sumo.report.sweep_formats import change_text, mean_text, sweep_columns, sweep_notes, sweep_rows
from interplan_sumo.report.sweep_lines import SweepLine, reference_setting
from interplan_sumo.report.sweep_plot import SCALE, along_axis, drawn_measures, ordered_values
from interplan_sumo.statistics.intervals import Range
from interplan_sumo.world.files import writing

TICKS: Final = 4
FALL_STEP: Final = 20.0
"""Points between the ticks of changes."""

Figure = tuple[float, Range | None, str]
"""What is drawn of a line: a value, its interval and what it says."""


def write_sweep_page(parameters: Sequence[Parameter], lines: Sequence[SweepLine], path: Path, command: str) -> None:
    """The page; InputError if it cannot be written. Names are text whatever they hold."""
    text = sweep_page(parameters, lines, command)
    with writing(path, "give another folder as --out"):
        path.write_text(text, encoding="utf-8")


def sweep_page(parameters: Sequence[Parameter], lines: Sequence[SweepLine], command: str) -> str:
    """A sweep as HTML."""
    planners = list(dict.fromkeys(line.planner for line in lines))
    return html(
        "sweep.html.j2",
        style=style_of("page.css", "realism.css", "curves.css"),
        script="",
        keys=[parameter.key for parameter in parameters],
        colours={name: number % COLOURS for number, name in enumerate(planners)},
        changes=change_panels(parameters, lines),
        measures=measure_panels(parameters, lines),
        reference=", ".join(f"{key}={value}" for key, value in reference_setting(lines).items()),
        table={"title": "Of each combination", "columns": sweep_columns(parameters, lines), "rows": sweep_rows(lines)},
        notes=list(sweep_notes(parameters, lines)),
        command=command,
        wide=WIDE,
        high=HIGH,
        left=LEFT,
    )


def change_panels(parameters: Sequence[Parameter], lines: Sequence[SweepLine]) -> list[CurvePanel]:
    """By how much the score of each planner differs from that in the reference; a panel for all other parameters."""
    reference = reference_setting(lines)
    found: dict[int, Figure] = {}
    for line in lines:
        if line.change is not None:
            found[id(line)] = line.change.value, line.change.interval, change_text(line.change)
        elif line.setting == reference and line.complete:
            found[id(line)] = 0.0, None, "held against"
    ends = [end for value, interval, _ in found.values() for end in interval or (value, value)]
    low = FALL_STEP * min((end // FALL_STEP for end in ends), default=-1.0)
    high = FALL_STEP * max((-(-end // FALL_STEP) for end in ends), default=0.0)
    span = min(low, -FALL_STEP), max(high, 0.0)
    return _panels("change of the score, points", parameters, lines, found, span) if len(found) > 1 else []


def measure_panels(parameters: Sequence[Parameter], lines: Sequence[SweepLine]) -> list[CurvePanel]:
    """The main measures; a panel of each for all other parameters."""
    panels: list[CurvePanel] = []
    for measure in drawn_measures(lines):
        means = [(line, line.means[measure.key]) for line in lines]
        found = {id(line): (mean.value, mean.interval, mean_text(measure, mean)) for line, mean in means if mean}
        panels += _panels(measure.label, parameters, lines, found, SCALE)
    return panels


def _panels(
    title: str, parameters: Sequence[Parameter], lines: Sequence[SweepLine], found: Mapping[int, Figure], span: Range
) -> list[CurvePanel]:
    """Over the parameter that lies along the axis, one for each combination of the others."""
    along = along_axis(parameters)
    others = [{key: value for key, value in line.setting.items() if key != along.key} for line in lines]
    distinct = [setting for number, setting in enumerate(others) if setting not in others[:number]]
    panels: list[CurvePanel] = []
    for setting in distinct:
        own = [line for line, other in zip(lines, others, strict=True) if other == setting]
        name = ", ".join([title, *(f"{key} {value}" for key, value in setting.items())])
        panels.append(_panel(name, along, own, found, span))
    return panels


def _panel(
    title: str, along: Parameter, lines: Sequence[SweepLine], found: Mapping[int, Figure], span: Range
) -> CurvePanel:
    values = ordered_values(along)
    planners = list(dict.fromkeys(line.planner for line in lines))
    curves: list[PlannerCurve] = []
    said: list[str] = []
    for number, planner in enumerate(planners):
        marks: list[CurveMark] = []
        own = [line for line in lines if line.planner == planner and id(line) in found]
        for line in sorted(own, key=lambda line: values.index(line.setting[along.key])):
            value, interval, text = found[id(line)]
            x = place_along(values.index(line.setting[along.key]), len(values)) + aside(number, len(planners))
            bar = "" if interval is None else bar_between(x, *(height(end, *span) for end in interval))
            said.append(f"{line.name}: {text}")
            marks.append(CurveMark(round(x, 1), round(height(value, *span), 1), bar, interval is None, said[-1]))
        path = line_through([(mark.x, mark.y) for mark in marks])
        curves.append(PlannerCurve(planner, number % COLOURS, path, "", tuple(marks)))
    low, high = span
    ticks = round((high - low) / FALL_STEP) if span != SCALE else TICKS
    upwards = [low + (high - low) * number / ticks for number in range(ticks + 1)]
    return CurvePanel(
        title=title,
        planners=tuple(curves),
        along=tuple((round(place_along(number, len(values)), 1), value) for number, value in enumerate(values)),
        upwards=tuple((round(height(value, *span), 1), f"{value:g}") for value in upwards),
        axis=along.key,
        about="; ".join(said),
    )
