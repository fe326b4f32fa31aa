"""Fresh scenes: scores in scenes that chance made after everything was tuned, beside those in the suites.

A line per planner and scene. Who drives again takes the place of its former self, and all drive the same scenes.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from interplan_sumo.families import names
from interplan_sumo.report.table import ResultsTable
from interplan_sumo.world.csv_tables import number_in, read_table, write_table
from tools.cells import RARE, cell_text, family_titles, heading
from tools.hard_scores import RESULTS, Half, totals
from tools.kept_drives import complete_run, refuse_other_traffic, renewed, traffic_of
from tools.kept_sweeps import SUITE

KEPT: Final = RESULTS / "fresh.csv"
COLUMNS: Final = ("planner", "planner_hash", "traffic_version", "scenario", "family", "score")


def keep_fresh(scenes: Path, runs: Path) -> None:
    """Keep the scores in those scenes that are certified, of each map a folder of `generate` and, alike named, a run.

    Ends the program if the runs are of a suite or of other traffic, or if not all of their planners would have
    driven the same scenes.
    """
    plain, places = traffic_of(SUITE), [made for made in sorted(scenes.iterdir()) if made.is_dir()]
    found = [line for made in places for line in _certified(made, runs / made.name, plain)]
    kept = renewed(KEPT, COLUMNS, found)
    driven: dict[str, list[str]] = {}
    for planner, _, _, scene, *_ in kept:
        driven.setdefault(planner, []).append(scene)
    first = next(iter(driven))
    for planner, of in driven.items():
        if of != driven[first]:
            raise SystemExit(f"{planner} drove other scenes than {first}; let all drive the same")
    write_table(KEPT, COLUMNS, kept)


def _certified(made: Path, folder: Path, plain: int) -> list[tuple[str, ...]]:
    run = complete_run(folder)
    about = run.manifest
    refuse_other_traffic(folder, about, plain)
    report = read_table(made / "report.csv", ("scenario_id", "certified"))
    certified = {line["scenario_id"] for line in report if line["certified"] == "True"}
    rows = [run.rows[key] for key in run.keys if key[0] in certified and key[2] == 0]
    if any(row.official for row in rows):
        raise SystemExit(f"{folder} is of {about.suite}; drive scenes of `scenarios generate`")
    return [
        (
            row.planner, about.planners[row.planner].hash, str(about.traffic_version), row.scenario_id,
            row.family, f"{row.score or 0.0:.4f}",
        )
        for row in rows
    ]  # fmt: skip


def fresh(rare: ResultsTable, large: ResultsTable) -> list[str]:
    """What planners get in scenes of chance, beside what they have in the suite and in the large one."""
    half: Half = {}
    for line in read_table(KEPT, COLUMNS):
        of = half.setdefault(line["planner"], {family: [] for family in names(ordinary=False)})
        of[line["family"]].append(number_in(line["score"], KEPT))
    suites = [{line.planner: cell_text(line.cells[RARE]) for line in table.lines} for table in (rare, large)]
    count = sum(map(len, next(iter(half.values())).values()))
    lines = heading("planner", rare.suite, large.suite, f"{count} fresh scenes", *family_titles(rare))
    for name, total in totals(half).items():
        before = (of.get(name, "-") for of in suites)
        cells = (f"{100.0 * np.mean(each):.0f}" for each in half[name].values())
        lines.append(" | ".join((f"`{name}`", *before, total, *cells)))
    return lines
