"""Compare: two runs drive by drive, on equal scenario and seed, so that what both find hard cancels out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np

from interplan_sumo.batch.records import Brief, JobKey, Row
from interplan_sumo.batch.run_folder import StoredRun
from interplan_sumo.errors import InputError, RunFolderError, UnknownNameError
from interplan_sumo.report.failure_reasons import fault_sentence, metric_sentence
from interplan_sumo.report.table import BOOTSTRAP_SEED, MANY_DRIVES, RESAMPLES, Z_95, planner_label
from interplan_sumo.world.geometry import Floats

TIE = 1e-6
"""Scores, 0 to 1, this close are equal: scores of one drive agree to this across machines."""
WAY_OUT = {
    "suite": "only drives of one suite can be compared",
    "suite_hash": "the suite has changed in between: drive both with one version",
    "traffic_version": "the traffic drives otherwise since: drive both with one version",
    "profile": "--profile NAME scores both again",
}
"""What must be the same in both manifests, and what to do where it is not."""

DriveKey = tuple[str, int]
"""Scenario id and seed."""


@dataclass(frozen=True, slots=True)
class ScoreChange:
    """One drive that both runs have."""

    scenario_id: str
    family: str
    seed: int
    a: float
    b: float
    """Scores, 0 to 1."""
    reason: str
    """What the worse of the two lost that the other did not; empty for a tie."""

    @property
    def difference(self) -> float:
        return self.b - self.a

    @property
    def winner(self) -> str:
        """`a`, `b` or `tie`."""
        return "tie" if abs(self.difference) <= TIE else "b" if self.difference > 0.0 else "a"


@dataclass(frozen=True, slots=True)
class GroupComparison:
    """The comparison over all drives, or over those of one family; scores 0 to 100."""

    scenarios: int
    drives: int
    a: float | None
    b: float | None
    difference: float | None
    """Mean of b less a, over the scenarios, of the mean over the seeds; None without drives."""
    interval: tuple[float, float] | None
    """95 % of the bootstrap means when scenarios, or the seeds of a single one, are drawn again; None for one drive."""
    wins: int
    """Drives where b is better."""
    losses: int
    ties: int


@dataclass(frozen=True, slots=True)
class Comparison:
    """What `compare` found: b against a."""

    a: str
    b: str
    """Run folder and planner, as the user knows them."""
    suite: str
    profile: str
    overall: GroupComparison
    families: dict[str, GroupComparison]
    changes: tuple[ScoreChange, ...]
    """Drives of both runs, the largest change first."""
    missing_a: tuple[DriveKey, ...]
    missing_b: tuple[DriveKey, ...]
    """Drives that only the other run has a score for, or that neither has."""

    @property
    def complete(self) -> bool:
        return not (self.missing_a or self.missing_b)


def compare(
    run_a: StoredRun, run_b: StoredRun, planner_a: str | None = None, planner_b: str | None = None
) -> Comparison:
    """Planner `planner_b` of the second run against `planner_a` of the first, on all drives that either was to do.

    A planner need not be named where its run holds only one, or where the other
    run holds the same. RunFolderError if the runs differ in suite, profile or
    scoring version; InputError if the planner is not told.
    """
    for what, way_out in WAY_OUT.items():
        held, other = (getattr(each.manifest, what) for each in (run_a, run_b))
        if held != other:
            raise RunFolderError(
                f"{run_a.path} has {what.replace('_', ' ')} {held}, {run_b.path} has {other}; {way_out}"
            )
    sure_a, sure_b = _sure_planner(run_a, planner_a), _sure_planner(run_b, planner_b)
    planner_a = sure_a or _same_planner(run_a, sure_b, "a")
    planner_b = sure_b or _same_planner(run_b, sure_a, "b")
    drives_a, drives_b = _drives(run_a, planner_a), _drives(run_b, planner_b)
    versions = {drive.scoring for drive in (*drives_a.values(), *drives_b.values()) if drive and drive.scoring}
    if len(versions) > 1:
        raise RunFolderError(
            f"{run_a.path} and {run_b.path} hold scores of different scoring versions ({sorted(versions)}); "
            "--profile NAME scores both again"
        )
    changes = [
        _change(run_a, run_b, (key[0], planner_a, key[1]), (key[0], planner_b, key[1]), drive_a, drive_b)
        for key, drive_a in drives_a.items()
        if drive_a and (drive_b := drives_b.get(key))
    ]
    families = {family: [c for c in changes if c.family == family] for family in (c.family for c in changes)}
    keys = list(dict.fromkeys((*drives_a, *drives_b)))
    return Comparison(
        a=f"{run_a.path.name}: {planner_label(planner_a, run_a)}",
        b=f"{run_b.path.name}: {planner_label(planner_b, run_b)}",
        suite=run_a.manifest.suite,
        profile=run_a.manifest.profile,
        overall=_share(changes),
        families={family: _share(members) for family, members in families.items()},
        changes=tuple(sorted(changes, key=lambda c: (-abs(c.difference), c.scenario_id, c.seed))),
        missing_a=tuple(key for key in keys if not drives_a.get(key)),
        missing_b=tuple(key for key in keys if not drives_b.get(key)),
    )


def _sure_planner(run: StoredRun, name: str | None) -> str | None:
    """The planner that was named, or the only one of the run; UnknownNameError for one that it does not hold."""
    held = run.planners
    if name is None:
        return held[0] if len(held) == 1 else None
    if name not in held:
        raise UnknownNameError(f"planner in {run.path}", name, held)
    return name


def _same_planner(run: StoredRun, other: str | None, side: str) -> str:
    """The planner of the other run, if this run of several planners holds it as well."""
    held = run.planners
    if other in held:
        return other
    raise InputError(f"{run.path} holds {len(held)} planners ({', '.join(held)}); name one: --planner-{side} NAME")


def _drives(run: StoredRun, planner: str) -> dict[DriveKey, Brief | None]:
    """Every drive that was asked of a planner, None where there is no score."""
    briefs = run.briefs
    drives = {(key[0], key[2]): briefs.get(key) for key in run.keys if key[1] == planner}
    return {key: drive if drive is not None and drive.score is not None else None for key, drive in drives.items()}


def _change(
    run_a: StoredRun, run_b: StoredRun, key_a: JobKey, key_b: JobKey, drive_a: Brief, drive_b: Brief
) -> ScoreChange:
    """Two drives with a score; their rows are read only where they differ."""
    a, b = float(drive_a.score or 0.0), float(drive_b.score or 0.0)
    reason = ""
    if abs(b - a) > TIE:
        row_a, row_b = run_a.rows[key_a], run_b.rows[key_b]
        worse, better = (row_a, row_b) if a < b else (row_b, row_a)
        reason = f"{'a' if a < b else 'b'}: {_lost(worse, better)}"
    return ScoreChange(key_a[0], drive_a.family, key_a[2], a, b, reason)


def _lost(worse: Row, better: Row) -> str:
    """Why one drive of a scenario scored less than the other: its fault, else the metrics that it did worse in."""
    if worse.fault:
        return fault_sentence(worse)
    judged = {} if better.fault else better.judged
    names = [name for name, score in worse.judged.items() if score < judged.get(name, 1.0)]
    gates = [name for name in names if name in worse.gates]
    return "; ".join(metric_sentence(worse, name) for name in gates or names) or "other weights"


def _share(changes: Sequence[ScoreChange]) -> GroupComparison:
    by_scenario: dict[str, list[ScoreChange]] = {}
    for change in changes:
        by_scenario.setdefault(change.scenario_id, []).append(change)

    def means(name: str) -> Floats:
        per_scenario = [np.mean([getattr(c, name) for c in members]) for members in by_scenario.values()]
        return 100.0 * np.array(per_scenario, dtype=np.float64)

    winners = [change.winner for change in changes]
    some = bool(changes)
    return GroupComparison(
        scenarios=len(by_scenario),
        drives=len(changes),
        a=float(means("a").mean()) if some else None,
        b=float(means("b").mean()) if some else None,
        difference=float(means("difference").mean()) if some else None,
        # of a single scenario all there is to draw again are its seeds
        interval=mean_interval(means("difference") if len(by_scenario) > 1 else _differences(changes)),
        wins=winners.count("b"),
        losses=winners.count("a"),
        ties=winners.count("tie"),
    )


def _differences(changes: Sequence[ScoreChange]) -> Floats:
    return 100.0 * np.array([change.difference for change in changes], dtype=np.float64)


def mean_interval(values: Floats) -> tuple[float, float] | None:
    """95 % percentile bootstrap of the mean of values (K,), one per scenario; None for fewer than two.

    Of more than MANY_DRIVES values, the interval that it tends to.

    Scenarios are drawn again and keep their seeds together, because drives of
    one scenario are not independent. The generator is fixed: the same values
    give the same interval.
    """
    if len(values) < 2:
        return None
    if len(values) > MANY_DRIVES:
        mean, reach = float(values.mean()), Z_95 * float(values.std()) / sqrt(len(values))
        return mean - reach, mean + reach
    rng = np.random.default_rng(BOOTSTRAP_SEED)
    low, high = np.percentile(values[rng.integers(0, len(values), (RESAMPLES, len(values)))].mean(axis=1), (2.5, 97.5))
    return float(low), float(high)
