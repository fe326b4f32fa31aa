"""Kept sweeps: what `sweep` found of one parameter on the suite of rare scenes, and the tables that it gives.

A line per value and planner, as in the sweep.csv that it comes from, and of which traffic and planner it is. Who is
swept again takes the place of its former self.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from interplan_sumo.batch.run_folder import read_run
from interplan_sumo.world.csv_tables import read_table, write_table
from tools.cells import heading
from tools.hard_scores import RESULTS
from tools.kept_drives import refuse_others

SUITE: Final = "interplan==1"
PARAMETERS: Final = ("track", "behaviour")
"""Of which there are tables."""
COLUMNS: Final = ("planner", "drives", "missing", "score", "score_low", "score_high", "faults")
"""Those that are needed of any."""
OF: Final = ("traffic_version", "planner_hash")
"""Columns that sweep.csv has not."""


def kept(parameter: str) -> Path:
    """Where what was found of a parameter is kept."""
    return RESULTS / f"sweep-{parameter}.csv"


def keep_sweep(folder: Path) -> None:
    """Keep what a sweep found beside what others drove; ends the program if it is of something else.

    That is of another suite or traffic than the drives of the suite that are kept, which its scores are set beside.
    """
    fresh = read_table(folder / "sweep.csv", COLUMNS)
    parameter = next(iter(fresh[0]))
    if parameter not in PARAMETERS:
        raise SystemExit(f"{folder} swept {parameter}, expected {' or '.join(PARAMETERS)}")
    runs = {run.name: read_run(run).manifest for run in sorted(folder.glob(f"{parameter}=*")) if run.is_dir()}
    refuse_others(folder, SUITE, runs.values())
    for line in fresh:
        about = runs.get(f"{parameter}={line[parameter]}")
        if about is None or line["missing"] != "0" or line["faults"]:
            raise SystemExit(f"{folder} lacks drives of {line['planner']}, or they have faults; complete it first")
        line |= dict(zip(OF, (str(about.traffic_version), about.planners[line["planner"]].hash), strict=True))
    held = _lines(kept(parameter)) if kept(parameter).is_file() else []
    again = {line["planner"] for line in fresh}
    lines = sorted([*fresh, *(line for line in held if line["planner"] not in again)], key=lambda line: line["planner"])
    columns = tuple(fresh[0])
    for line in lines:
        if line.keys() != {*columns}:
            raise SystemExit(f"{kept(parameter)} has other columns than {folder} for {line['planner']}; sweep all anew")
    write_table(kept(parameter), columns, [tuple(line[name] for name in columns) for line in lines])


def tracks(plain: dict[str, str]) -> list[str]:
    """What planners keep of their scores where scenes are made harder; `plain` says what they have as it is."""
    found = by_planner("track")
    values = list(dict.fromkeys(value for of in found.values() for value in of))
    lines = heading("planner", "plain", *values, f"at fault in {', '.join(values)} %")
    for planner in sorted(found, key=lambda name: -float(plain[name].split()[0])):
        of = found[planner]
        fault = ", ".join(_figure(of[value], "at_fault_collisions") if value in of else "-" for value in values)
        scores = (_score(of[value]) if value in of else "-" for value in values)
        lines.append(" | ".join((f"`{planner}`", plain[planner], *scores, fault)))
    return lines


def behaviours() -> list[str]:
    """What planners do among drivers that are all of one kind."""
    lines = heading("planner", "drivers", "drives", "at-fault collisions %", "goal lane %", "score")
    for planner, of in by_planner("behaviour").items():
        for value, line in of.items():
            shares = (_figure(line, key) for key in ("at_fault_collisions", "goal_lane"))
            lines.append(" | ".join((f"`{planner}`", value, line["drives"], *shares, _score(line))))
    return lines


def by_planner(parameter: str) -> dict[str, dict[str, dict[str, str]]]:
    """The kept lines by planner and value."""
    found: dict[str, dict[str, dict[str, str]]] = {}
    for line in _lines(kept(parameter)):
        found.setdefault(line["planner"], {})[line[parameter]] = line
    return found


def _lines(path: Path) -> list[dict[str, str]]:
    return read_table(path, (*COLUMNS, *OF))


def _score(line: dict[str, str]) -> str:
    return f"{_figure(line, 'score')} [{_figure(line, 'score_low')}, {_figure(line, 'score_high')}]"


def _figure(line: dict[str, str], key: str) -> str:
    return f"{float(line[key]):.0f}"
