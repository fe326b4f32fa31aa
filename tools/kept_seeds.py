"""Kept seeds: scores of the suite of rare scenes in other traffic of the same scenes, and the table that they give.

A line per planner, scene and seed. Who is driven again takes the place of its former self.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from interplan_sumo.batch.run_folder import read_run
from interplan_sumo.world.csv_tables import number_in, read_table, write_table
from tools.cells import heading
from tools.hard_scores import RESULTS, Half, totals
from tools.kept_drives import complete_run, folder_of, refuse_others, renewed
from tools.kept_sweeps import SUITE

KEPT: Final = RESULTS / "interplan-1-seeds.csv"
COLUMNS: Final = ("planner", "planner_hash", "traffic_version", "seed", "scenario", "family", "score")
LEAST: Final = 2
"""Seeds of a run that is worth keeping here."""


def keep_seeds(folder: Path) -> None:
    """Keep the scores of a run with several seeds; ends the program if it is of another suite or traffic."""
    run = complete_run(folder)
    about = run.manifest
    refuse_others(folder, SUITE, (about,))
    rows = [run.rows[key] for key in run.keys]
    if len({row.seed for row in rows}) < LEAST:
        raise SystemExit(f"{folder} has one seed; run with --seeds 3")
    fresh = [
        (
            row.planner, about.planners[row.planner].hash, str(about.traffic_version), str(row.seed), row.scenario_id,
            row.family, f"{row.score or 0.0:.4f}",
        )
        for row in rows
    ]  # fmt: skip
    write_table(KEPT, COLUMNS, renewed(KEPT, COLUMNS, fresh))


def seeds() -> list[str]:
    """What planners get in other traffic of the same scenes, and how much of it is the traffic's."""
    scores: dict[str, dict[str, dict[str, dict[str, float]]]] = {}
    kept = read_table(KEPT, COLUMNS)
    for line in kept:
        family = scores.setdefault(line["planner"], {}).setdefault(line["family"], {})
        family.setdefault(line["scenario"], {})[line["seed"]] = number_in(line["score"], KEPT)
    every = sorted({line["seed"] for line in kept}, key=int)
    lines = heading("planner", *(f"seed {seed}" for seed in every), "all", "spread of a scene", "two seeds apart")
    half: Half = {
        name: {
            family: [float(np.mean([*of.values()])) for of in scenes.values()] for family, scenes in sorted(by.items())
        }
        for name, by in scores.items()
    }
    sites = {row.scenario_id: row.site for row in read_run(folder_of(SUITE)).rows.values()}
    places = {family: [sites[scene] for scene in scenes] for family, scenes in next(iter(scores.values())).items()}
    for name, total in totals(half, places).items():
        table = np.array([[of[seed] for seed in every] for scenes in scores[name].values() for of in scenes.values()])
        spread = 100.0 * float(np.sqrt(table.var(axis=1, ddof=1).mean()))
        apart = 1.96 * np.sqrt(2.0) * spread / np.sqrt(len(table))
        cells = (f"{100.0 * each:.0f}" for each in table.mean(axis=0))
        lines.append(" | ".join((f"`{name}`", *cells, total, f"{spread:.0f}", f"{apart:.0f}")))
    return lines
