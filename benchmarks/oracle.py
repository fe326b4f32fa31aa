"""What choosing could be worth: `python -m benchmarks.oracle [--out FILE.jsonl] [--drives 24] [--keep]`

Drives the hybrid on interplan==1 with the best choices that are found by trying
them out: decision by decision, each option by a whole drive, a few rules after
it, until the score is full. Writes a line per scenario and goes on where it was
stopped; `--keep` stores its scores for the table in docs/language_models.md.
About ten minutes on one core.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from msgspec import to_builtins
from rich.console import Console

from interplan_llm.hybrid.choosers import RuleChooser
from interplan_llm.hybrid.planner import HybridPlanner
from interplan_sumo.batch.records import ScoreRecord
from interplan_sumo.maps.store import load_roads
from interplan_sumo.metrics.score import score
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.scenario.suite import expert, find_suite
from interplan_sumo.world.trajectory import Trajectory
from tools.language_models import keep_oracle
from tools.oracle import Effort, OracleChooser, oracle_drive

SUITE = "interplan==1"


def hybrid(chooser: OracleChooser, recorded: Sequence[Trajectory]) -> HybridPlanner:
    return HybridPlanner(chooser, recorded=recorded)


def in_numbers(effort: Effort) -> dict[str, float]:
    return {"every": effort.every, "hold": effort.hold, "drives": effort.most_drives}


def searched(scenario: Scenario, seed: int, effort: Effort) -> dict[str, Any]:
    """What the oracle makes of one scenario: a row as of a run, and how it got there."""
    reference = expert(scenario)
    found = oracle_drive(scenario, reference, hybrid, RuleChooser(), seed=seed, effort=effort)
    episode = found.episode
    row: dict[str, Any] = {"scenario_id": scenario.id, "family": scenario.family, "seed": seed}
    row |= {"planner": "oracle", "official": True, "times_s": {}}
    row |= {"effort": in_numbers(effort), "drives": found.drives, "fault": None, "score": 0.0, "metrics": {}}
    if episode.trace is None or episode.fault is not None:
        kind, text = (episode.fault.kind, episode.fault.message) if episode.fault else ("harness", "nothing was driven")
        row["fault"] = {"class": kind, "message": text}
    else:
        sheet = score(episode.trace, load_roads(scenario.map, scenario.maps_beside), reference, scenario)
        row |= to_builtins(ScoreRecord.of(sheet))
    row["choices"] = [[round(each.scene.time_s, 3), str(each.taken)] for each in found.choices]
    return row


def rows_of(path: Path | None, seed: int, effort: Effort) -> dict[str, dict[str, Any]]:
    """Rows of an earlier call with the same options, by scenario; ends the program for a file of another one."""
    if path is None or not path.is_file():
        return {}
    rows = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    if any((row["seed"], row["effort"]) != (seed, in_numbers(effort)) for row in rows):
        sys.exit(f"error: {path} is of another seed or effort; give another file as --out")
    return {row["scenario_id"]: row for row in rows}


def keep(path: Path | None, rows: Sequence[dict[str, Any]]) -> None:
    if path is not None:
        fresh = path.with_name(f"{path.name}.new")
        fresh.write_text("".join(json.dumps(row) + "\n" for row in rows), encoding="utf-8")
        fresh.replace(path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, help="a line per scenario; what it holds is not done again")
    parser.add_argument("--every", type=int, default=2, help="look at every n-th decision")
    parser.add_argument("--hold", type=int, default=3, help="keep an option for so many decisions")
    parser.add_argument("--drives", type=int, default=24, help="per scenario; then no further decision is looked at")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", action="store_true", help="store what was found for the table in the docs")
    given = parser.parse_args()
    effort = Effort(given.every, given.hold, given.drives)
    usual = all(getattr(given, name) == parser.get_default(name) for name in ("seed", "every", "hold", "drives"))
    if given.keep and not usual:
        parser.error("--keep is for the usual seed and effort, which the table is of")
    console, rows = Console(width=120), rows_of(given.out, given.seed, effort)
    scenarios = find_suite(SUITE).scenarios
    for number, scenario in enumerate(scenarios, start=1):
        if scenario.id not in rows:
            rows[scenario.id] = searched(scenario, given.seed, effort)
            keep(given.out, list(rows.values()))
        row = rows[scenario.id]
        console.print(f"[{number}/{len(scenarios)}] {scenario.id}: {row['score']:.3f} in {row['drives']} drives")
    if given.keep:
        keep_oracle([rows[scenario.id] for scenario in scenarios])
    scores, drives = zip(*((row["score"], row["drives"]) for row in rows.values()), strict=True)
    console.print(f"{100.0 * sum(scores) / len(scores):.1f} points in {sum(drives)} drives")
    console.print(f"{drives.count(1)} scenarios needed no more than the rules")


if __name__ == "__main__":
    main()
