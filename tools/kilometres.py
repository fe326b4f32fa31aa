"""Kilometres: the segments that `endure` drove, as they are kept, and the tables that they give."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import lru_cache, reduce
from pathlib import Path
from typing import Final

import msgspec

from interplan_sumo.batch.records import decode, encode
from interplan_sumo.endurance.cell_regression import cell_regression
from interplan_sumo.endurance.formats import FigureTable, rates_table, regression_tables
from interplan_sumo.endurance.gathered import read_kilometres
from interplan_sumo.endurance.kilometres import ABOUT, SEGMENTS, AboutEndure
from interplan_sumo.endurance.rate_sample import MeasureKey
from interplan_sumo.endurance.rates import RateEstimate
from interplan_sumo.endurance.report import EnduranceReport, endurance_report
from tools.hard_scores import RESULTS

KEPT: Final = RESULTS / "endure"
"""A folder that `rates` takes, and from a copy of which `endure` goes on; without the kept events."""


def keep_kilometres(folders: Iterable[Path]) -> None:
    """Put the segments of folders of `endure` beside those that are kept; InputError if they are of other code."""
    every = [*([KEPT] if (KEPT / ABOUT).is_file() else ()), *folders]
    segments = read_kilometres(every)
    about = reduce(AboutEndure.beside, (decode((folder / ABOUT).read_bytes(), AboutEndure) for folder in every))
    KEPT.mkdir(parents=True, exist_ok=True)
    (KEPT / ABOUT).write_bytes(msgspec.json.format(encode(about), indent=1) + b"\n")
    order = sorted(segments, key=lambda each: (each.planner, each.cell, each.seed, each.index))
    (KEPT / SEGMENTS).write_bytes(b"".join(encode(each) + b"\n" for each in order))


@lru_cache
def _report() -> EnduranceReport:
    return endurance_report(read_kilometres([KEPT]))


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


def _depends(measure: MeasureKey) -> list[str]:
    report = _report()
    of_measure = replace(report, measure=measure, regression=cell_regression(report.rates.cells, measure))
    return _lines(regression_tables(of_measure)[0])


def _lines(table: FigureTable) -> list[str]:
    return [" | ".join(table.columns), "---|" * (len(table.columns) - 1) + "---", *map(" | ".join, table.rows)]
