"""Rude egos in random traffic: does a vehicle do what none can? `python -m benchmarks.traffic_fuzz --agent-seconds N`.

Scenes of the suites and new ones on the shipped maps (and on two imported ones where INTERPLAN_REALDATA names their
folder), all densities, all shipped vehicle types and ten car-following models, eleven egos. Every frame is held
against tests/simulation/traffic_invariants.py; each drive has a twin in which nobody meets the ego, and every tenth is
driven twice and must be equal to the bit. Exits 1 if anything was found but what comes bit by bit in plain SUMO, too,
where nothing of ours acts, and vehicles that come or go in sight where a road of the map ends: they can nowhere else.

One case again, in a second or two: --case NUMBER [--agent ID [--frame K]] prints its violations, and how that agent
drives around a frame. --scenario ID --ego NAME [--seed N] [--types FILE] does so for a scene of the suites.
"""

from __future__ import annotations

import argparse
import json
import os
import shlex
import sys
from collections import Counter, defaultdict
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict, dataclass
from functools import partial
from itertools import count
from multiprocessing import get_context
from pathlib import Path
from tempfile import gettempdir

import numpy as np

from interplan_sumo.maps.importers.importing import import_map
from interplan_sumo.scenario.suite import find_scenario
from interplan_sumo.simulation.vehicle_types import vehicle_type_file
from tests.simulation.fuzz_cases import SHIPPED_MAPS, SUITES, Case, Maps, Outcome, case, run
from tests.simulation.rude_egos import behaviours
from tests.simulation.traffic_invariants import Violation, slip_deg

REAL_MAPS = {
    "austin": ("argoverse2", "argoverse2/austin_0a1e6f0a"),
    "lankershim": ("sumo", "sumo_nets/ngsim_lankershim.net.xml"),
}
MOST_PER_CASE_S = 1000.0
"""So many agent-seconds there are per case, at most."""
AGAIN = 50
"""One in so many cases is driven once more in a fresh process."""
WORST = 5
"""Of each kind, as many are printed."""


@dataclass(frozen=True, slots=True)
class Finding:
    """A violation with everything that repeats it."""

    case: int
    scenario: str
    seed: int
    ego: str
    types: str
    agent_type: str
    kind: str
    frame: int
    agent: str
    value: float
    detail: str


@dataclass(frozen=True, slots=True)
class Report:
    """What one case came to, small enough to send between processes."""

    case: int
    agent_s: float
    agents: int
    findings: tuple[Finding, ...]
    ego: str
    hash: str = ""
    """Of all frames."""


def scratch() -> Path:
    """Where derived types and imported maps are kept between runs."""
    folder = Path(gettempdir()) / "interplan_traffic_fuzz"
    folder.mkdir(exist_ok=True)
    return folder


def imported_maps() -> tuple[str, ...]:
    """Folders of the real maps, imported once; none without INTERPLAN_REALDATA."""
    root = os.environ.get("INTERPLAN_REALDATA")
    if not root:
        return ()
    folders: list[str] = []
    for name, (format, source) in REAL_MAPS.items():
        folder = scratch() / "maps" / name
        if not (folder / "1.0" / "ids.json").exists():
            import_map(Path(root) / source, format, folder, overwrite=True)
        folders.append(str(folder))
    return tuple(folders)


def driven(number: int, *, seed: int, maps: Maps, steps: int) -> Report:
    """Case `number`, in a worker."""
    made = case(seed, number, maps, scratch())
    outcome = run(made, steps=steps, twice=number % 10 == 0)
    found = [
        Finding(
            number, made.scenario.id, made.seed, made.ego, made.drivers, _type_of(outcome, each), each.kind,
            each.frame, each.agent, round(each.value, 3), each.detail,
        )
        for each in outcome.violations
    ]  # fmt: skip
    return Report(number, outcome.agent_s, len(outcome.types), tuple(found), made.ego, outcome.hash)


def _type_of(outcome: Outcome, violation: Violation) -> str:
    return "+".join(outcome.types.get(name, "-") for name in violation.agent.split("+"))


def fuzz(agent_s: float, *, seed: int, maps: Maps, steps: int, workers: int, quiet: bool = False) -> list[Report]:
    """Case after case until so many agent-seconds are driven. A worker that dies is a finding, too.

    Scenes differ in size by a hundred times, so there is also a least number of cases.
    """
    reports: list[Report] = []
    done_s, numbers = 0.0, count()

    def enough() -> bool:
        return done_s >= agent_s and len(reports) >= agent_s / MOST_PER_CASE_S

    drive = partial(driven, seed=seed, maps=maps, steps=steps)
    while not enough():
        open_: dict[Future[Report], int] = {}
        with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
            try:
                while open_ or not enough():
                    while not enough() and len(open_) < 2 * workers:
                        number = next(numbers)
                        open_[pool.submit(drive, number)] = number
                    ready, _ = wait(open_, return_when=FIRST_COMPLETED)
                    for future in ready:
                        report = future.result()
                        open_.pop(future)
                        reports.append(report)
                        done_s += report.agent_s
                        if not quiet:
                            _tell(report, done_s, agent_s)
            except BrokenProcessPool:
                reports += [_alone(drive, number) for number in open_.values()]
                done_s = sum(report.agent_s for report in reports)
    reports.sort(key=lambda each: each.case)
    return [*reports, *_not_the_same_again(drive, reports[::AGAIN])]


def _not_the_same_again(drive: partial[Report], reports: list[Report]) -> list[Report]:
    """Reports of those that come out otherwise in a fresh process."""
    found: list[Report] = []
    for before in reports:
        after = _alone(drive, before.case)
        if after.hash != before.hash:
            said = Finding(before.case, "?", 0, before.ego, "?", "-", "not_repeatable", 0, "", 0.0, "in two processes")
            found.append(Report(before.case, 0.0, 0, (said,), before.ego))
    return found


def _alone(drive: partial[Report], number: int) -> Report:
    """One case in a process of its own."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        try:
            return pool.submit(drive, number).result()
        except BrokenProcessPool:
            crash = Finding(number, "?", 0, "?", "?", "-", "crash", 0, "", 0.0, "the worker process died")
            return Report(number, 0.0, 0, (crash,), "?")


def _tell(report: Report, done_s: float, agent_s: float) -> None:
    kinds = Counter(each.kind for each in report.findings if not each.kind.startswith("without_ego"))
    words = ", ".join(f"{kind} {many}" for kind, many in sorted(kinds.items())) or "-"
    print(f"[{done_s:.0f}/{agent_s:.0f}] case {report.case} {report.ego}: {words}", file=sys.stderr, flush=True)


def summary(reports: list[Report], seed: int, maps: Maps, steps: int) -> str:
    """What was found, by kind, the worst of each with the command that repeats it."""
    agent_s = sum(report.agent_s for report in reports)
    by_kind: dict[str, list[Finding]] = defaultdict(list)
    for report in reports:
        for each in report.findings:
            by_kind[each.kind].append(each)
    lines = [f"{len(reports)} cases, {agent_s:.0f} agent-seconds, seed {seed}", ""]
    lines.append(f"{'kind':34} {'count':>6} {'cases':>6} {'per 1000 agent-s':>17} {'worst':>9}")
    for kind, found in sorted(by_kind.items()):
        worst = max(each.value for each in found)
        rate, cases = 1000.0 * len(found) / max(agent_s, 1.0), len({each.case for each in found})
        lines.append(f"{kind:34} {len(found):6} {cases:6} {rate:17.3f} {worst:9.2f}")
    for kind, found in sorted(by_kind.items()):
        lines += ["", kind]
        shown: set[int] = set()
        for each in sorted(found, key=lambda each: -each.value):
            if each.case in shown or len(shown) == WORST:
                continue
            shown.add(each.case)
            lines.append(
                f"  {each.value:8.2f} frame {each.frame:3} agent {each.agent} ({each.agent_type}; {each.types}) "
                f"{each.scenario} ego {each.ego}: {each.detail}"
            )
            lines.append(f"           {repeat_command(each, seed, maps, steps)}")
    return "\n".join(lines)


def broken(reports: list[Report]) -> list[Finding]:
    """The findings that must not be."""
    return [
        each
        for report in reports
        for each in report.findings
        if not each.kind.startswith(("in_plain_sumo", "without_ego")) and not each.kind.endswith("at_map_end")
    ]


def repeat_command(finding: Finding, seed: int, maps: Maps, steps: int) -> str:
    """What drives the case of a finding again: cases are drawn from all maps and suites that there were."""
    words = ["python", "-m", "benchmarks.traffic_fuzz", "--seed", str(seed), "--case", str(finding.case)]
    words += ["--steps", str(steps)]
    words += [word for name in maps.names for word in ("--maps", name)]
    words += [word for suite in maps.suites for word in ("--suite", suite)]
    if finding.agent:
        words += ["--agent", finding.agent.split("+")[0], "--frame", str(finding.frame)]
    return shlex.join(words)


def again(made: Case, steps: int, agent: str | None, frame: int | None) -> int:
    """One case with everything about it; 1 if it has violations."""
    outcome = run(made, steps=steps)
    print(f"case {made.number}: {made.scenario.id} on {made.scenario.map}, seed {made.seed}, ego {made.ego}")
    print(f"types {made.types} ({made.drivers}); {made.scenario.traffic}; {outcome.agent_s:.0f} agent-seconds")
    for each in outcome.violations:
        print(
            f"{each.kind:28} frame {each.frame:3} {each.agent} ({_type_of(outcome, each)}) {each.value:.2f} "
            f"{each.detail}"
        )
    for title, drive in (("", outcome.drive), ("without the ego: ", outcome.twin)):
        if agent is None or drive is None or agent not in drive.ids:
            continue
        i, middle = drive.ids.index(agent), frame or 0
        slip = slip_deg(drive, 0.2)
        print(f"\n{title}agent {agent}, {drive.length_m[i]:.1f} x {drive.width_m[i]:.2f} m")
        print("frame       x         y    heading    shown    SUMO      a     slip | ego x       y   heading  speed")
        for k in range(max(0, middle - 10), min(len(drive.x_m), middle + 11)):
            a = (drive.sumo_mps[k, i] - drive.sumo_mps[k - 1, i]) / 0.1 if k else np.nan
            print(
                f"{k:5} {drive.x_m[k, i]:9.2f} {drive.y_m[k, i]:9.2f} {np.degrees(drive.heading_rad[k, i]):8.2f} "
                f"{drive.speed_mps[k, i]:8.2f} {drive.sumo_mps[k, i]:8.2f} {a:7.2f} "
                f"{slip[k - 1, i] if k else np.nan:7.2f} | {drive.ego[k, 0]:9.2f} {drive.ego[k, 1]:9.2f} "
                f"{np.degrees(drive.ego[k, 2]):8.2f} {outcome.egos[k].speed_mps:6.2f}"
            )
    return int(bool(outcome.violations))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--agent-seconds", type=float, default=20_000.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--suite", action="append", help="scenes of these suites (default: interplan==1 and common==1)")
    parser.add_argument("--maps", action="append", help="new scenes on these maps, by name or folder (default: all)")
    parser.add_argument("--steps", type=int, default=300, help="of 0.1 s, of each drive")
    parser.add_argument("--case", type=int, help="this one only")
    parser.add_argument("--scenario", help="this scene of a suite, instead of a case")
    parser.add_argument("--ego", default="cruising", choices=list(behaviours()))
    parser.add_argument("--types", type=Path, help="vehicle types, instead of the scene's own")
    parser.add_argument("--agent", help="of that case, show how it drives")
    parser.add_argument("--frame", type=int, help="around this frame")
    parser.add_argument("--json", type=Path, help="write all findings there")
    options = parser.parse_args()
    known = tuple(options.maps) if options.maps else (*SHIPPED_MAPS, *imported_maps())
    maps = Maps(known, tuple(options.suite or SUITES))
    one = None
    if options.case is not None:
        one = case(options.seed, options.case, maps, scratch())
    elif options.scenario is not None:
        scene = find_scenario(options.scenario)
        file = options.types or vehicle_type_file(scene.traffic.behaviour)
        one = Case(0, scene, options.seed, options.ego, file, file.stem)
    if one is not None:
        return again(one, options.steps, options.agent, options.frame)
    reports = fuzz(options.agent_seconds, seed=options.seed, maps=maps, steps=options.steps, workers=options.workers)
    print(summary(reports, options.seed, maps, options.steps))
    if options.json is not None:
        options.json.write_text(json.dumps([asdict(report) for report in reports]))
    return int(bool(broken(reports)))


if __name__ == "__main__":
    sys.exit(main())
