"""Kilometres: the segments that `endure` drove, as they are kept, and the tables that they give."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import replace
from functools import lru_cache, reduce
from itertools import chain
from pathlib import Path
from typing import Final

import msgspec
import numpy as np

from interplan_sumo.batch.records import decode, encode
from interplan_sumo.endurance.cell_regression import cell_regression
from interplan_sumo.endurance.formats import FigureTable, rates_table, regression_tables
from interplan_sumo.endurance.gathered import read_kilometres
from interplan_sumo.endurance.kilometres import ABOUT, SEGMENTS, AboutEndure, read_segments
from interplan_sumo.endurance.looks import hours_needed, stopped_at
from interplan_sumo.endurance.rate_sample import MEASURES, MeasureKey, measure_of
from interplan_sumo.endurance.rates import RateEstimate, endurance_rates
from interplan_sumo.endurance.records import SegmentRecord
from interplan_sumo.endurance.report import WANTED, EnduranceReport, endurance_report
from interplan_sumo.statistics.event_rates import FEWEST_EFFECTIVE, ClusterSums, Floats, effective_size
from tools.cells import heading
from tools.hard_scores import RESULTS

KEPT: Final = RESULTS / "endure"
"""A folder that `rates` takes, and from a copy of which `endure` goes on; without the kept events."""
WEIGHED: Final[tuple[MeasureKey, ...]] = ("at_fault_collision", "near_miss", "hard_braking", "stall")
"""Measures by which boosted and naive segments are held against one another, and of which pilots tell how far it is."""
PILOT_M: Final = 50_000.0
ROUNDS: Final = 2
"""Segments of each cell from one look to the next."""

Key = tuple[object, ...]
"""Which segment it is, whoever drove it when."""


def key_of(segment: SegmentRecord) -> Key:
    return segment.planner, segment.cell, segment.seed, segment.index


def keep_kilometres(folders: Iterable[Path]) -> None:
    """Put the segments of folders of `endure` beside those that are kept, or in their place if these are of other code
    and all are there again (`tools.renewed_kilometres`).

    InputError if the folders are of different code, SystemExit if they lack some.
    """
    every = list(folders)
    segments = read_kilometres(every)
    if (KEPT / ABOUT).is_file():
        if _about(KEPT).code == _about(every[0]).code:
            every.insert(0, KEPT)
            segments = read_kilometres(every)
        elif lacking := {*map(key_of, read_segments(KEPT))} - {*map(key_of, segments)}:
            raise SystemExit(
                f"what is kept is of other code, and {len(lacking)} segments of it are not here; renew all"
            )
    about = reduce(AboutEndure.beside, map(_about, every))
    KEPT.mkdir(parents=True, exist_ok=True)
    (KEPT / ABOUT).write_bytes(msgspec.json.format(encode(about), indent=1) + b"\n")
    order = sorted(segments, key=lambda each: (each.planner, each.cell, each.seed, each.index))
    (KEPT / SEGMENTS).write_bytes(b"".join(encode(each) + b"\n" for each in order))


def _about(folder: Path) -> AboutEndure:
    return decode((folder / ABOUT).read_bytes(), AboutEndure)


@lru_cache
def _segments() -> list[SegmentRecord]:
    return read_kilometres([KEPT])


@lru_cache
def _report() -> EnduranceReport:
    return endurance_report(_segments())


def kilometres() -> list[str]:
    """What each planner did per 1000 km."""
    return _lines(rates_table(_report()))


def kilometres_collisions() -> list[str]:
    """What at-fault collisions depend on."""
    return _depends("at_fault_collision")


def kilometres_braking() -> list[str]:
    """What hard braking that the ego caused depends on."""
    return _depends("hard_braking")


def rates(measure: MeasureKey) -> dict[str, RateEstimate]:
    """How often that happened per 1000 km, by planner."""
    return {each.planner: each.measures[measure].total for each in _report().rates.planners if each.measures}


def drawn_rates(measure: MeasureKey) -> dict[str, Floats]:
    """(2000,) how often that happened per metre, by planner, with the starts drawn again."""
    samples = {each.planner: each.measures[measure].sample for each in _report().rates.planners if each.measures}
    return {name: sample.rates(sample.sums.drawn, "total") for name, sample in samples.items()}


def kilometres_weights() -> list[str]:
    """Boosted segments alone, each event and metre by its weight, over naive ones alone: 1 if weights are right."""
    lines = heading("planner", "events", "naive", "boosted", "of them effective", "boosted over naive")
    for planner in sorted({each.planner for each in _segments()}):
        segments = [each for each in _segments() if each.planner == planner]
        starts = [(each.cell.map, each.start) for each in segments]
        for measure in WEIGHED:
            seen = [[event.weight for event in each.events if measure_of(event) == measure] for each in segments]
            naive = [len(weights) if each.naive else 0 for each, weights in zip(segments, seen, strict=True)]
            boosted = [[] if each.naive else weights for each, weights in zip(segments, seen, strict=True)]
            effective = effective_size(np.array(list(chain.from_iterable(boosted))))
            if min(sum(naive), effective) < FEWEST_EFFECTIVE:
                continue
            metres = [(each.metres, 0.0) if each.naive else (0.0, each.weighted_metres) for each in segments]
            rows = np.column_stack((naive, [float(np.sum(weights)) for weights in boosted], np.array(metres)))
            ratio = ClusterSums(rows, starts).rate(_boosted_over_naive)
            assert ratio is not None
            low, high = ratio.interval()
            told = f"{ratio.value:.2f} [{low:.2f}, {high:.2f}]"
            numbers = (str(sum(naive)), str(sum(map(len, boosted))), f"{effective:.0f}")
            lines.append(" | ".join((planner, MEASURES[measure], *numbers, told)))
    return lines


def kilometres_pilots() -> list[str]:
    """What the first kilometres said that it takes to know a rate, and where it was known."""
    lines = heading("planner", "of", "km", "events", "it takes km", "hours of one core", "known after km")
    for planner in sorted({each.planner for each in _segments()}):
        segments = [each for each in _segments() if each.planner == planner]
        pilot = _first(segments, PILOT_M)
        rounds = min(Counter(each.cell for each in segments).values())
        every_m = sum(each.metres for each in segments if each.index < rounds)
        for measure in WEIGHED:
            driven = endurance_rates(pilot, only=(measure,)).planners[0]
            needed = hours_needed(driven, measure, WANTED)
            if needed is None:
                continue
            low, high = (each / needed.hours * needed.kilometres for each in needed.range)
            known = stopped_at(segments, measure, ROUNDS, WANTED)
            reached = f"{known.metres / 1000.0:.0f}" if known is not None else f"not in {every_m / 1000.0:.0f}"
            told = f"{needed.kilometres:,.0f} [{low:,.0f}, {high:,.0f}]"
            km = f"{sum(each.metres for each in pilot) / 1000.0:.0f}"
            events = f"{needed.events:.0f}"
            lines.append(" | ".join((planner, MEASURES[measure], km, events, told, f"{needed.hours:.1f}", reached)))
    return lines


def _first(segments: list[SegmentRecord], metres: float) -> list[SegmentRecord]:
    """The first segments of all cells, as many of each, that are so long."""
    most = 1 + max(each.index for each in segments)
    parts = ([each for each in segments if each.index < number] for number in range(1, most))
    return next((part for part in parts if sum(each.metres for each in part) >= metres), segments)


def _boosted_over_naive(sums: Floats) -> Floats:
    """Of sums (..., 4): naive and boosted events, naive and boosted metres."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return (sums[..., 1] / sums[..., 3]) / (sums[..., 0] / sums[..., 2])


def _depends(measure: MeasureKey) -> list[str]:
    report = _report()
    of_measure = replace(report, measure=measure, regression=cell_regression(report.rates.cells, measure))
    return _lines(regression_tables(of_measure)[0])


def _lines(table: FigureTable) -> list[str]:
    return [*heading(*table.columns), *map(" | ".join, table.rows)]
