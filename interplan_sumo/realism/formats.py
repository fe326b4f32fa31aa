"""The realism report for people and for programs: tables on a terminal, and one JSON document."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final

from interplan_sumo.realism.comparison import FEWEST, FeatureComparison, RealismReport, RealismRow
from interplan_sumo.realism.distances import Sample
from interplan_sumo.realism.features import FEATURES, TrafficFeature
from interplan_sumo.realism.likelihood import ceiling

if TYPE_CHECKING:
    from rich.console import RenderableType

QUANTILES: Final = (0.05, 0.5, 0.95)
COLUMNS: Final = (
    "feature", "simulated n", "recorded n", "simulated p5 / p50 / p95", "recorded p5 / p50 / p95", "KS",
    "KS, median of places", "places apart", "Wasserstein", "likelihood",
)  # fmt: skip
"""Of the table of a run."""
ROW_COLUMNS: Final = ("realism", "of at most", "that is")
"""Of the table of all rows, before a column for each feature."""


def realism_json(report: RealismReport) -> dict[str, Any]:
    """As one document; null where there is nothing to say."""
    recorded = report.recorded
    scored = {each.key for each in recorded.scored}
    return {
        "features": [
            {
                "key": each.key,
                "unit": each.unit,
                "bins": {"low": each.bins.low, "high": each.bins.high, "count": each.bins.count},
                "weight": each.weight,
                "scored": each.key in scored,
                "recorded": _sample(recorded.together[each.key]),
                "ceiling": _rounded(ceiling(recorded.together[each.key], each.bins)) if each.key in scored else None,
                "ks_between_places": _rounded(report.between_places.get(each.key)),
            }
            for each in FEATURES
        ],
        "places": [
            {"place": name, "road_users": {each.key: samples[each.key].road_users for each in FEATURES}}
            for name, samples in recorded.places.items()
        ],
        "rows": [_row(row) for row in report.rows],
    }


def _row(row: RealismRow) -> dict[str, Any]:
    return {
        "name": row.name,
        "kind": row.kind,
        "realism": _rounded(row.realism),
        "ceiling": _rounded(row.ceiling),
        "share_of_ceiling": _rounded(row.share),
        "features": {key: _feature(found) for key, found in row.features.items()},
    }


def _feature(found: FeatureComparison) -> dict[str, Any]:
    return {
        "simulated": _sample(found.simulated),
        "recorded": _sample(found.recorded),
        "ks": _rounded(found.ks),
        "wasserstein": _rounded(found.wasserstein),
        "ks_by_place": {place: _rounded(ks) for place, ks in found.ks_by_place.items()},
        "median_ks_by_place": _rounded(found.median_ks),
        "likelihood": _rounded(found.likelihood),
    }


def _sample(sample: Sample) -> dict[str, Any]:
    quantiles = [_rounded(sample.quantile(share)) if len(sample) else None for share in QUANTILES]
    return {
        "values": len(sample),
        "road_users": sample.road_users,
        **dict(zip(("p5", "p50", "p95"), quantiles, strict=True)),
    }


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 4)


def realism_tables(report: RealismReport) -> Iterator[RenderableType]:
    """For people: each run feature by feature, then all rows with their numbers."""
    from rich.table import Table as Grid
    from rich.text import Text

    for row in report.rows:
        if row.kind == "run":
            grid = Grid(title=Text(row.name), title_justify="left")
            for title in COLUMNS:
                grid.add_column(title, justify="left" if title == "feature" else "right")
            for feature in FEATURES:
                grid.add_row(*feature_cells(feature, row.features[feature.key], report))
            yield grid
    shown = [each for each in FEATURES if len(report.recorded.together[each.key])]
    grid = Grid(title="Realism, and KS distance to the recordings", title_justify="left")
    grid.add_column("traffic", min_width=max(len(row_title(row)) for row in report.rows))
    for title in (*ROW_COLUMNS, *(each.short for each in shown)):
        grid.add_column(title, justify="right")
    for row in report.rows:
        grid.add_row(Text(row_title(row)), *row_figures(row), *(_figure(row.features[each.key].ks) for each in shown))
    yield grid
    for line in report_notes(report):
        yield Text(line)


def feature_cells(feature: TrafficFeature, found: FeatureComparison, report: RealismReport) -> list[str]:
    """A line of a run's table."""
    return [
        f"{feature.title} ({feature.unit})",
        str(found.simulated.road_users),
        str(found.recorded.road_users),
        quantiles_text(found.simulated),
        quantiles_text(found.recorded),
        _figure(found.ks),
        _figure(found.median_ks),
        _figure(report.between_places.get(feature.key)),
        _figure(found.wasserstein),
        _figure(found.likelihood, 3),
    ]


def quantiles_text(sample: Sample) -> str:
    """The 5th, 50th and 95th percentile."""
    return " / ".join(_figure(sample.quantile(share)) for share in QUANTILES) if len(sample) else "-"


def row_title(row: RealismRow) -> str:
    """A recording's row says what it is: that place played back, beside the others."""
    return f"log replay of {row.name}" if row.kind == "recording" else row.name


def row_figures(row: RealismRow) -> tuple[str, str, str]:
    """Those of `ROW_COLUMNS`."""
    return _figure(row.realism, 3), _figure(row.ceiling, 3), "-" if row.share is None else f"{100.0 * row.share:.0f} %"


def report_notes(report: RealismReport) -> list[str]:
    """What a reader of the figures must know."""
    unscored = [each.title for each in FEATURES if each not in report.recorded.scored]
    places = ", ".join(report.recorded.places)
    notes = [
        f"n counts road users, each of which weighs the same. Recorded places: {places}; the log replay of a place is "
        "compared with all others.",
        "Realism: weighted mean of the likelihoods of the recorded values, in the form of Waymo's sim-agents metric; "
        "at most: what the recordings have by themselves. "
        "Places apart: the median KS distance of two places; a simulation that is as near to them as they are to one "
        "another is as good as recordings of another place.",
    ]
    if unscored:
        notes.append(f"Not in the number, for fewer than {FEWEST} road users were recorded: {', '.join(unscored)}.")
    return notes


def _figure(value: float | None, digits: int = 2) -> str:
    return "-" if value is None else f"{value:z.{digits}f}"
