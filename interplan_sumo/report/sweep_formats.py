"""Sweep formats: the lines of a sweep as JSON, CSV or text for a terminal, and the words of its page."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from interplan_sumo.batch.sweep import Parameter
from interplan_sumo.report.standing import standing
from interplan_sumo.report.standing_formats import BRACKETS, alike_note, detectable_note
from interplan_sumo.report.sweep_lines import (
    HARD_BRAKING_MPS2,
    MEASURES,
    Change,
    Mean,
    Measure,
    SweepLine,
    idle_parameters,
    reference_setting,
)
from interplan_sumo.report.text import grid


def sweep_json(lines: Sequence[SweepLine]) -> list[dict[str, Any]]:
    """The lines as plain data; null where there is no figure."""
    return [
        {
            "setting": dict(line.setting),
            "planner": line.planner,
            "scenarios": line.scenarios,
            "seeds": line.seeds,
            "drives": line.asked - len(line.missing),
            "complete": line.complete,
            "measures": {measure.key: _mean_json(measure, line.means[measure.key]) for measure in MEASURES},
            "change": _change_json(line.change),
            "faults": dict(line.faults),
            "missing": [{"scenario_id": scenario, "seed": seed} for scenario, _, seed in line.missing],
            "failure": line.failure,
        }
        for line in lines
    ]


def _mean_json(measure: Measure, mean: Mean | None) -> dict[str, Any] | None:
    if mean is None:
        return None
    interval = None if mean.interval is None else [round(bound, 4) for bound in mean.interval]
    highest = {"max": round(mean.highest, 4)} if measure.highest else {}
    counts = {"scenarios": mean.scenarios, "drives": mean.drives}
    return {"mean": round(mean.value, 4), "interval": interval, **highest, **counts}


def _change_json(change: Change | None) -> dict[str, Any] | None:
    if change is None:
        return None
    interval = None if change.interval is None else [round(bound, 4) for bound in change.interval]
    return {"score": round(change.value, 4), "interval": interval}


def sweep_csv(lines: Sequence[SweepLine]) -> str:
    """One row per line, empty where there is no figure; `_low` and `_high` bound the 95 % interval of a mean.

    Holds nothing that was measured with a clock: equal sweeps give equal bytes.
    """
    text = io.StringIO()
    keys = list(lines[0].setting)
    titles = [f"{measure.key}{end}" for measure in MEASURES for end in _ends(measure)]
    titles += ["change", "change_low", "change_high"]
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*keys, "planner", "scenarios", "seeds", "drives", "missing", *titles, "faults"])
    for line in lines:
        figures = [figure for measure in MEASURES for figure in _figures(measure, line.means[measure.key])]
        change = line.change
        figures += _written((None,) * 3 if change is None else (change.value, *(change.interval or (None, None))))
        counts = [line.scenarios, line.seeds, line.asked - len(line.missing), len(line.missing)]
        faults = " ".join(f"{name}:{count}" for name, count in line.faults.items())
        writer.writerow([*line.setting.values(), line.planner, *counts, *figures, faults])
    return text.getvalue()


def _ends(measure: Measure) -> tuple[str, ...]:
    return ("", "_low", "_high", "_max") if measure.highest else ("", "_low", "_high")


def _figures(measure: Measure, mean: Mean | None) -> list[str]:
    values: tuple[float | None, ...] = (None,) * 4
    if mean is not None:
        values = (mean.value, *(mean.interval or (None, None)), mean.highest)
    return _written(values[: len(_ends(measure))])


def _written(values: Sequence[float | None]) -> list[str]:
    return ["" if value is None else f"{value:.4f}" for value in values]


def sweep_text(parameters: Sequence[Parameter], lines: Sequence[SweepLine]) -> RenderableType:
    """The table for a terminal, and below it what did not work."""
    table = grid(sweep_columns(parameters, lines), sweep_rows(lines), left=[len(parameters)])
    return Group(table, *map(Text, sweep_notes(parameters, lines)))


def sweep_columns(parameters: Sequence[Parameter], lines: Sequence[SweepLine]) -> list[str]:
    """What the table has."""
    titles = [measure.title for measure in _shown(lines)]
    return [
        *(parameter.key for parameter in parameters),
        "planner",
        "drives",
        titles[0],
        "change",
        *titles[1:],
        "faults",
    ]


def sweep_rows(lines: Sequence[SweepLine]) -> list[list[str]]:
    """Its cells in words."""
    shown = _shown(lines)
    return [_row(line, shown) for line in lines]


def _shown(lines: Sequence[SweepLine]) -> list[Measure]:
    score, *others = MEASURES
    return [score, *(measure for measure in others if any(line.means[measure.key] for line in lines))]


def sweep_notes(parameters: Sequence[Parameter], lines: Sequence[SweepLine]) -> Iterator[str]:
    """What stands below the table."""
    against = ", ".join(f"{key}={value}" for key, value in reference_setting(lines).items())
    yield (
        f"Means over the scenarios; brackets: {BRACKETS} Change: of the score against {against}, paired scene by "
        f"scene. Hard braking: a follower of the ego brakes harder than {HARD_BRAKING_MPS2} m/s². Braking behind: the "
        "hardest braking of a follower, m/s², mean over the drives (highest)."
    )
    yield from _standing_notes(lines)
    for key in idle_parameters(parameters, lines):
        yield f"{key} makes no difference: no figure of any drive depends on it."
    incomplete = [line for line in lines if line.missing]
    for line in incomplete:
        first = ", ".join(f"{scenario} seed {seed}" for scenario, _, seed in line.missing[:3])
        more = f" and {len(line.missing) - 3} more" if len(line.missing) > 3 else ""
        why = f": {line.failure}" if line.failure else ""
        yield f"no score: {line.name}, {first}{more}{why}"
    if incomplete:
        yield "INCOMPLETE: repeat the command to do what is missing."


def _standing_notes(lines: Sequence[SweepLine]) -> list[str]:
    """Which combinations differ in score by more than chance, and how large a difference would show."""
    held = standing(("score",), [{"score": line.scores} for line in lines])
    names = [line.name for line in lines]
    return [*([detectable_note(held, "score")] if held.detectable else []), *alike_note(held, names)]


def _row(line: SweepLine, shown: Sequence[Measure]) -> list[str]:
    drives = f"{line.asked - len(line.missing)}" + (f" of {line.asked}" if line.missing else "")
    faults = ", ".join(f"{count} {name}" for name, count in line.faults.items()) or "-"
    score, *cells = [mean_text(measure, line.means[measure.key]) for measure in shown]
    return [*line.setting.values(), line.planner, drives, score, change_text(line.change), *cells, faults]


def change_text(change: Change | None) -> str:
    """With its sign, and its interval in brackets."""
    if change is None:
        return "-"
    return f"{change.value:+.1f}" + ("" if change.interval is None else " [{:+.0f}, {:+.0f}]".format(*change.interval))


def mean_text(measure: Measure, mean: Mean | None) -> str:
    """With its interval in brackets."""
    if mean is None:
        return "-"
    if measure.highest:
        return f"{mean.value:.1f} ({mean.highest:.1f})"
    form = ".1f" if measure.key == "score" else ".0f"
    return f"{mean.value:{form}}" + ("" if mean.interval is None else " [{:.0f}, {:.0f}]".format(*mean.interval))
