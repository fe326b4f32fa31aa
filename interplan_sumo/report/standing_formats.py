"""Standing formats: who cannot be told apart from the best, and what a table can detect, as notes and as JSON."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from interplan_sumo.errors import counted
from interplan_sumo.report.standing import DetectableDifference, Standing
from interplan_sumo.report.table import Column, ResultsTable
from interplan_sumo.report.text import points_text, rounded
from interplan_sumo.statistics.detection import POWER, SIGNIFICANCE
from interplan_sumo.statistics.intervals import DRAWS

BRACKETS = (
    "95 % interval for scenarios like these, which are drawn again within their families with all their seeds "
    f"({DRAWS} draws)."
)
NAMED = 12
"""So many lines are named in a note; the rest is counted."""


def standing_json(table: ResultsTable) -> dict[str, Any]:
    """The least detectable difference of the table as one number, that of each column, and all pairs of lines."""
    held, labels = table.standing, [line.label for line in table.lines]
    pairs = [
        {
            "a": labels[each.pair.a],
            "b": labels[each.pair.b],
            "difference": rounded(each.pair.estimate.value),
            "ci": [rounded(bound) for bound in each.pair.estimate.interval],
            "p": rounded(each.pair.estimate.p_value),
            "p_holm": rounded(each.adjusted_p),
            "scenarios": each.pair.estimate.scenes,
            "paired": each.pair.paired,
        }
        for each in held.contrasts
    ]
    overall = held.detectable.get(held.column)
    return {
        "least_detectable_difference": overall and rounded(overall.middle),
        "comparison": {
            "column": held.column,
            "best": None if held.best is None else labels[held.best],
            "not_told_apart_from_best": [labels[line] for line in held.alike],
            "significance": SIGNIFICANCE,
            "power": POWER,
            "draws": DRAWS,
            "least_detectable_differences": {key: _span_json(span) for key, span in held.detectable.items()},
            "pairs": pairs,
        },
    }


def _span_json(span: DetectableDifference) -> dict[str, Any]:
    figures = {name: rounded(getattr(span, name)) for name in ("least", "middle", "greatest")}
    return {**figures, "paired": span.paired}


def standing_notes(table: ResultsTable) -> list[str]:
    """What the brackets are, the least detectable difference, and who cannot be told apart from the best."""
    held = table.standing
    found: list[str] = []
    if any(cell.interval for line in table.lines for cell in line.cells.values()):
        found.append(f"Brackets: {BRACKETS}")
    if held.column in held.detectable:
        title = next(column.title for column in table.columns if column.key == held.column)
        single = [column.key for column in table.columns if _of_one_family(column, table)]
        found.append(detectable_note(held, title, [held.detectable[key] for key in single if key in held.detectable]))
    return [*found, *alike_note(held, [line.label for line in table.lines])]


def _of_one_family(column: Column, table: ResultsTable) -> bool:
    """Whether it is about one family of several."""
    return len(table.families) > 1 and sum(column.covers(family) for family in table.families) == 1


def detectable_note(held: Standing, title: str, families: Sequence[DetectableDifference] = ()) -> str:
    """The least detectable difference of the whole, called `title`, and of single families, as a sentence."""
    overall = held.detectable[held.column]
    of_families = ""
    if families:
        least, greatest = min(each.least for each in families), max(each.greatest for each in families)
        of_families = f"; in a single family {_between(least, greatest)}"
    how = "paired scenario by scenario" if overall.paired else "between lines on scenarios of their own"
    return (
        f"Least detectable difference ({100 * POWER:.0f} % power, two-sided {100 * SIGNIFICANCE:.0f} %), {how}: "
        f"{title} {_points(overall)}{of_families}."
    )


def _points(span: DetectableDifference) -> str:
    if points_text(span.least) == points_text(span.greatest):
        return f"{points_text(span.middle)} points"
    return f"{points_text(span.middle)} points ({_between(span.least, span.greatest)} over the pairs of lines)"


def _between(least: float, greatest: float) -> str:
    low, high = points_text(least), points_text(greatest)
    return low if low == high else f"{low} to {high}"


def alike_note(held: Standing, labels: Sequence[str]) -> list[str]:
    """Who cannot be told apart from the best, as a sentence; nothing where there is nobody to compare."""
    if len(held.drives) < 2:
        return []
    if held.best is None:
        told = _named([f"{labels[line]} {counted(count, 'drive')}" for line, count in held.drives.items()])
        return [f"No best: the lines have not driven the same ({told}); `compare` takes what two of them share."]
    best = labels[held.best]
    how = f"(paired bootstrap over scenarios, Holm over {len(held.contrasts)} pair{'s' * (len(held.contrasts) != 1)})"
    if not held.contrasts:
        return [f"Most: {best}. Scenarios at one place are too few to compare lines."]
    if not held.alike:
        return [f"Best: {best}. It can be told apart from every other line {how}."]
    if held.too_few is not None:
        pairs = len(held.contrasts)
        scenes, places = held.too_few
        at = f" at {counted(places, 'place')}" if places < scenes else ""
        few = f"{scenes} scenarios{at} are too few to tell lines apart among {counted(pairs, 'pair')}"
        alone = "; `compare` looks at two alone" if pairs > 1 else ""
        return [f"Best: {best}. {few}, however much they differ{alone}."]
    names = [labels[line] for line in held.alike]
    if len(names) > 1 and not held.behind:
        return [f"Best: {best}. None of the other {len(names)} lines can be told apart from it {how}."]
    return [f"Best: {best}. Not to be told apart from it {how}: {_named(names)}."]


def _named(names: Sequence[str]) -> str:
    more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return f"{'; '.join(names[:NAMED])}{more}"
