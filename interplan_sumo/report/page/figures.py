"""Figures of the page: how scores spread over the bands, families with their scenes, and what columns mean."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from markupsafe import Markup

from interplan_sumo.batch.run_folder import StoredRun
from interplan_sumo.batch.stored_drive import StoredDrives
from interplan_sumo.errors import InterplanError
from interplan_sumo.families import families, find_family, named_family
from interplan_sumo.maps.store import load_roads
from interplan_sumo.report.page.drives import BANDS, ShownDrive, band, by_scenario, shown
from interplan_sumo.report.page.thumbnails import thumbnail
from interplan_sumo.report.standing import of_one_kind
from interplan_sumo.report.table import Column, ResultsTable


def best_figure(table: ResultsTable, column: Column) -> float | None:
    """The highest mean as it is shown, if two lines or more differ whose drives are `of_one_kind`."""
    having = [line for line in table.lines if line.cells[column.key].value is not None]
    values = [round(line.cells[column.key].value or 0.0) for line in having]
    if len(values) < 2 or max(values) == min(values) or not of_one_kind([line.drives(column) for line in having]):
        return None
    return min(values) if column.lower_is_better else max(values)


@dataclass(frozen=True, slots=True)
class BandShare:
    """The part of a planner's drives whose scores lie in one band; percent of the width of its bar."""

    band: str
    count: int
    left: float
    width: float


def score_spread(table: ResultsTable, drives: Sequence[ShownDrive]) -> list[tuple[str, list[BandShare]]]:
    """Of each line its label and the share of each band."""
    found: list[tuple[str, list[BandShare]]] = []
    for number, line in enumerate(table.lines):
        mine = [drive.band for drive in drives if drive.line == number]
        scored = max(1, sum(each != "none" for each in mine))
        shares, left = list[BandShare](), 0.0
        for name in BANDS:
            width = 100.0 * mine.count(name) / scored
            shares.append(BandShare(name, mine.count(name), left, width))
            left += width
        found.append((line.label, shares))
    return found


@dataclass(frozen=True, slots=True)
class ScenarioCell:
    """A planner's drives on one scenario: the mean over the seeds; a link leads to the worst of them."""

    text: str
    band: str
    worst: ShownDrive
    title: str

    @classmethod
    def of(cls, drives: Sequence[ShownDrive]) -> ScenarioCell | None:
        if not drives:
            return None
        scored = [drive.score for drive in drives if drive.score is not None]
        mean = sum(scored) / len(scored) if len(scored) == len(drives) else None
        worst = min(drives, key=lambda drive: drive.rank)
        figure = "no score" if mean is None else shown(mean)
        why = f": {worst.reasons[0]}" if worst.reasons else ""
        title = f"{worst.scenario}, {worst.label}: {figure}{why}"
        return cls("!" if mean is None else figure, band(mean), worst, title)


@dataclass(frozen=True, slots=True)
class FamilyMean:
    """A planner's mean over a family."""

    label: str
    text: str
    band: str
    title: str

    @classmethod
    def of(cls, label: str, drives: Sequence[ShownDrive], missing: bool) -> FamilyMean:
        scored = [drive.score for drive in drives if drive.score is not None]
        if missing or not drives or len(scored) < len(drives):
            return cls(label, "!" if drives else "-", "none", f"{label}: not all is driven")
        mean = round(sum(scored) / len(scored))
        return cls(label, str(mean), band(mean), f"{label}: {mean}, mean of {len(scored)} drives")


@dataclass(frozen=True, slots=True)
class FamilyBlock:
    """A family: a mean for each planner, and for each scenario its drawing and a cell for each planner."""

    family: str
    title: str
    about: str
    means: list[FamilyMean]
    scenarios: list[tuple[str, Markup, list[ScenarioCell | None]]]
    drives: list[ShownDrive]


def family_blocks(
    table: ResultsTable, drives: Sequence[ShownDrive], thumbnails: Mapping[str, Markup]
) -> list[FamilyBlock]:
    """A block per family, in the order of the drives; `thumbnails` are those of scenarios that can be drawn."""
    grouped: dict[str, list[ShownDrive]] = {}
    for drive in drives:
        grouped.setdefault(drive.family, []).append(drive)
    blocks: list[FamilyBlock] = []
    for family, mine in grouped.items():
        numbers = range(len(table.lines))
        cells = {
            scenario: [ScenarioCell.of([d for d in found if d.line == number]) for number in numbers]
            for scenario, found in by_scenario(mine).items()
        }
        means = [
            FamilyMean.of(
                line.label,
                [drive for drive in mine if drive.line == number],
                missing=any(scenario in cells or named_family(scenario) == family for scenario, _, _ in line.missing),
            )
            for number, line in enumerate(table.lines)
        ]
        kind = find_family(family)
        rows = [(scenario, thumbnails.get(scenario, Markup()), row) for scenario, row in cells.items()]
        blocks.append(FamilyBlock(family, kind.title, kind.description, means, rows, mine))
    return blocks


def scene_thumbnails(runs: Iterable[StoredRun]) -> dict[str, Markup]:
    """A drawing of each scenario of the runs that is as it was driven; of others there is none."""
    found: dict[str, Markup] = {}
    for run in runs:
        stored = None
        for key in run.keys:
            if key[0] in found or key not in run.rows:
                continue
            try:
                stored = stored or StoredDrives(run)
                scenario = stored.scenario(run.rows[key])
                found[key[0]] = thumbnail(scenario, load_roads(scenario.map, scenario.maps_beside))
            except InterplanError:
                continue
    return found


LEGEND: Final = {
    "ordinary": "mean score over ordinary driving",
    "interplan": "mean score over all scenes of this run: the figure to compare",
    "done_share": "drives of 100 that did what the scene asks for: passed the obstacle, reached the goal lane in time",
    "unsafe_share": (
        "drives of 100 that lost a gate of safety: a collision at fault, off the road, hard braking forced, "
        "people endangered"
    ),
    "paper_score": "the same drives by the paper's rules, which ask for less than the strict ones",
    "driv": "lane-change drives of 100 that stayed on the road",
    "goal": "lane-change drives of 100 that ended in the goal lane",
    "no_col": "lane-change drives of 100 without a collision at fault; other families do not count here",
}


def legend(columns: Iterable[Column]) -> list[tuple[str, str]]:
    """Of each column its title and what it tells."""
    by_key = {find_family(name).column_key or name: find_family(name) for name in families()}
    found: list[tuple[str, str]] = []
    for column in columns:
        family = by_key.get(column.key)
        about = LEGEND.get(column.key) or (f"mean score over {column.about}" if family is None else "")
        if family is not None:
            about = f"{family.title}, mean score. {family.description}".rstrip(". ") + "."
        found.append((column.title, about))
    return found
