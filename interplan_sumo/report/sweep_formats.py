"""Sweep formats: the lines of a sweep as JSON, CSV or text for a terminal."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from interplan_sumo.batch.sweep import Parameter
from interplan_sumo.report.standing import standing
from interplan_sumo.report.standing_formats import BRACKETS, alike_note, detectable_note
from interplan_sumo.report.sweep_lines import HARD_BRAKING_MPS2, MEASURES, Mean, Measure, SweepLine, idle_parameters
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


def sweep_csv(lines: Sequence[SweepLine]) -> str:
    """One row per line, empty where there is no figure; `_low` and `_high` bound the 95 % interval of a mean.

    Holds nothing that was measured with a clock: equal sweeps give equal bytes.
    """
    text = io.StringIO()
    keys = list(lines[0].setting)
    titles = [f"{measure.key}{end}" for measure in MEASURES for end in _ends(measure)]
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*keys, "planner", "scenarios", "seeds", "drives", "missing", *titles, "faults"])
    for line in lines:
        figures = [figure for measure in MEASURES for figure in _figures(measure, line.means[measure.key])]
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
    return ["" if value is None else f"{value:.4f}" for value in values[: len(_ends(measure))]]


def sweep_text(parameters: Sequence[Parameter], lines: Sequence[SweepLine]) -> RenderableType:
    """The table for a terminal, and below it what did not work."""
    shown = [measure for measure in MEASURES if any(line.means[measure.key] for line in lines)]
    titles = [*(parameter.key for parameter in parameters), "planner", "drives", *(m.title for m in shown), "faults"]
    parts: list[RenderableType] = [
        grid(titles, [_row(line, shown) for line in lines], left=[len(parameters)]),
        Text(
            f"Means over the scenarios; brackets: {BRACKETS} Hard braking: a follower of the ego brakes harder than "
            f"{HARD_BRAKING_MPS2} m/s². Braking behind: the hardest braking of a follower, m/s², mean over the drives "
            "(highest)."
        ),
        *map(Text, _standing_notes(lines)),
    ]
    parts += [
        Text(f"{key} makes no difference: no figure of any drive depends on it.")
        for key in idle_parameters(parameters, lines)
    ]
    incomplete = [line for line in lines if line.missing]
    for line in incomplete:
        name = ", ".join(f"{key}={value}" for key, value in line.setting.items())
        first = ", ".join(f"{scenario} seed {seed}" for scenario, _, seed in line.missing[:3])
        more = f" and {len(line.missing) - 3} more" if len(line.missing) > 3 else ""
        why = f": {line.failure}" if line.failure else ""
        parts.append(Text(f"no score: {name}, {line.planner}, {first}{more}{why}"))
    if incomplete:
        parts.append(Text("INCOMPLETE: repeat the command to do what is missing."))
    return Group(*parts)


def _standing_notes(lines: Sequence[SweepLine]) -> list[str]:
    """Which combinations differ in score by more than chance, and how large a difference would show."""
    held = standing(("score",), [{"score": line.scores} for line in lines])
    names = [", ".join([*(f"{key}={value}" for key, value in line.setting.items()), line.planner]) for line in lines]
    return [*([detectable_note(held, "score")] if held.detectable else []), *alike_note(held, names)]


def _row(line: SweepLine, shown: Sequence[Measure]) -> list[str]:
    drives = f"{line.asked - len(line.missing)}" + (f" of {line.asked}" if line.missing else "")
    faults = ", ".join(f"{count} {name}" for name, count in line.faults.items()) or "-"
    cells = [_cell(measure, line.means[measure.key]) for measure in shown]
    return [*line.setting.values(), line.planner, drives, *cells, faults]


def _cell(measure: Measure, mean: Mean | None) -> str:
    if mean is None:
        return "-"
    if measure.highest:
        return f"{mean.value:.1f} ({mean.highest:.1f})"
    form = ".1f" if measure.key == "score" else ".0f"
    return f"{mean.value:{form}}" + ("" if mean.interval is None else " [{:.0f}, {:.0f}]".format(*mean.interval))
