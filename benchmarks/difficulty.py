"""How hard is a generated suite? python -m benchmarks.difficulty suites/interplan-1 [--workers 2]

Drives planners of every strength through the scenes of a folder that `scenarios generate` made and prints their strict
scores, 0 to 100, per family: who keeps its lane, looks at nothing, or follows the published rules should be far below
who plans, no family should be lost for all, and density should cost points.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import interplan_sumo

PLANNERS = {
    "straight_ahead": "straight_ahead",
    "idm": "idm",
    "published MOBIL": "idm_mobil?published=true",
    "idm_mobil": "idm_mobil",
    "pdm_closed": "pdm_closed",
    "foresight": "foresight",
}


def main() -> None:
    """Drive, and print the table and the spread between the best and the worst."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="with scenarios.yaml and certificates.parquet")
    parser.add_argument("--workers", type=int, default=None)
    parser.add_argument("--out", type=Path, default=Path("runs/difficulty"))
    given = parser.parse_args()
    scenes = given.folder / "scenarios.yaml"
    run = interplan_sumo.run(list(PLANNERS.values()), scenarios=scenes, out=given.out, workers=given.workers)
    table = interplan_sumo.table(run)
    print(table.to_string(float_format=lambda value: f"{value:.0f}"))
    mean = run.groupby("planner")["score"].mean() * 100.0
    print(f"from {mean.idxmin()} {mean.min():.0f} to {mean.idxmax()} {mean.max():.0f}")
    lost = run.groupby("scenario_id")["score"].max() < 0.8
    print(f"solved by none of them: {', '.join(lost[lost].index) or 'no scene'}")


if __name__ == "__main__":
    main()
