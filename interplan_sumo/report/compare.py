"""Compare: two runs drive by drive, on equal scenario and seed, so that what both find hard cancels out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from interplan_sumo.batch.briefs import Brief
from interplan_sumo.batch.records import JobKey, Row
from interplan_sumo.batch.run_folder import StoredRun
from interplan_sumo.errors import InputError, UnknownNameError
from interplan_sumo.report.failure_reasons import fault_sentence, metric_sentence
from interplan_sumo.report.table import check_agree, planner_label, unsafe_share
from interplan_sumo.statistics.detection import SIGNIFICANCE, holm, least_detectable_difference
from interplan_sumo.statistics.intervals import DIFFERENCES, Range, mean_estimate
from interplan_sumo.statistics.scene_values import DriveKey, DriveValue, DriveValues, mean_over_scenes

TIE = 1e-6
"""Scores, 0 to 1, this close are equal: scores of one drive agree to this across machines."""
WAY_OUT = {
    "suite": "only drives of one suite can be compared",
    "suite_hash": "their scenes are not the same: drive both on one version of them",
    "traffic_version": "the traffic drives otherwise since: drive both with one version",
    "profile": "--profile NAME scores both again",
    "scoring_version": "--profile NAME scores both again",
}
"""What must be the same in both manifests, and what to do where it is not."""


@dataclass(frozen=True, slots=True)
class ScoreChange:
    """One drive that both runs have."""

    scenario_id: str
    family: str
    site: str
    seed: int
    a: float
    b: float
    """Scores, 0 to 1."""
    unsafe_a: float | None
    unsafe_b: float | None
    """1 for an unsafe drive, else 0; None where the profile does not say."""
    reason: str
    """What the worse of the two lost that the other did not; empty for a tie."""

    @property
    def difference(self) -> float:
        """B less A."""
        return self.b - self.a

    @property
    def unsafe_difference(self) -> float | None:
        """B less A; None where one of them is not judged."""
        return None if self.unsafe_a is None or self.unsafe_b is None else self.unsafe_b - self.unsafe_a

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
    interval: Range | None
    """95 %, for scenarios like these (`statistics.intervals`); None for one scenario."""
    p_value: float | None
    """Of no difference, two-sided, by the same bootstrap."""
    least_detectable_difference: float | None
    """What would show in 80 of 100 such comparisons; None where all scenarios of each family differ alike."""
    unsafe_a: float | None
    unsafe_b: float | None
    """Percent of the drives, as mean over the scenarios; None where the profile does not say of all."""
    unsafe_interval: Range | None
    """95 % of the difference of these, b less a."""
    wins: int
    """Drives where b has more points."""
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
    adjusted_p: float | None = None
    """That of all drives after Holm, over all pairs of planners that are compared together; None if it has none."""

    @property
    def complete(self) -> bool:
        """Whether both have driven all that either was asked for."""
        return not (self.missing_a or self.missing_b)

    @property
    def scores_more(self) -> str | None:
        """`a` or `b`, where that is more than chance."""
        if self.adjusted_p is None or self.adjusted_p >= SIGNIFICANCE:
            return None
        return "b" if (self.overall.difference or 0.0) > 0.0 else "a"

    @property
    def better(self) -> str | None:
        """Who scores more, unless it is unsafe more often: points do not make up for that."""
        unsafe = {"a": self.overall.unsafe_a or 0.0, "b": self.overall.unsafe_b or 0.0}
        winner = self.scores_more
        return winner if winner and unsafe[winner] <= min(unsafe.values()) + TIE else None


@dataclass(frozen=True, slots=True)
class RunComparison:
    """Two runs, planner by planner."""

    suite: str
    profile: str
    pairs: tuple[Comparison, ...]
    only_a: tuple[str, ...]
    only_b: tuple[str, ...]
    """Planners that the other run does not hold, where all common ones are paired."""

    @property
    def complete(self) -> bool:
        """Whether every pair is."""
        return all(pair.complete for pair in self.pairs)


def compare_runs(
    run_a: StoredRun, run_b: StoredRun, planner_a: str | None = None, planner_b: str | None = None
) -> RunComparison:
    """Every planner that both runs hold in the second against itself in the first, or those that are named.

    The one planner of a run need not be named, nor one that the other side
    names. RunFolderError if the runs differ in suite, profile, or the version
    of traffic or scoring; InputError if it is not clear who is meant.
    """
    check_agree(run_a, run_b, WAY_OUT)
    named = _planner_pairs(run_a, run_b, planner_a, planner_b)
    pairs = [_compare(run_a, run_b, a, b) for a, b in named]
    tested = [pair.overall.p_value for pair in pairs if pair.overall.p_value is not None]
    adjusted = iter(holm(tested))
    return RunComparison(
        suite=run_a.manifest.suite,
        profile=run_a.manifest.profile,
        pairs=tuple(replace(p, adjusted_p=None if p.overall.p_value is None else next(adjusted)) for p in pairs),
        only_a=tuple(name for name in run_a.planners if name not in run_b.planners) if len(named) > 1 else (),
        only_b=tuple(name for name in run_b.planners if name not in run_a.planners) if len(named) > 1 else (),
    )


def _planner_pairs(
    run_a: StoredRun, run_b: StoredRun, planner_a: str | None, planner_b: str | None
) -> list[tuple[str, str]]:
    sure_a, sure_b = _sure_planner(run_a, planner_a), _sure_planner(run_b, planner_b)
    common = [name for name in run_a.planners if name in run_b.planners]
    if sure_a is None and sure_b is None and common and run_a.path.resolve() != run_b.path.resolve():
        return [(name, name) for name in common]
    return [(sure_a or _same_planner(run_a, sure_b, "a"), sure_b or _same_planner(run_b, sure_a, "b"))]


def _compare(run_a: StoredRun, run_b: StoredRun, planner_a: str, planner_b: str) -> Comparison:
    """One planner against one, on all drives that either was to do."""
    drives_a, drives_b = _drives(run_a, planner_a), _drives(run_b, planner_b)
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
        overall=_group(changes),
        families={family: _group(members) for family, members in families.items()},
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
    return ScoreChange(
        scenario_id=key_a[0],
        family=drive_a.family,
        site=drive_a.site,
        seed=key_a[2],
        a=a,
        b=b,
        unsafe_a=unsafe_share(drive_a),
        unsafe_b=unsafe_share(drive_b),
        reason=reason,
    )


def _lost(worse: Row, better: Row) -> str:
    """Why one drive of a scenario scored less than the other: its fault, else the metrics that it did worse in."""
    if worse.fault:
        return fault_sentence(worse)
    judged = {} if better.fault else better.judged
    names = [name for name, score in worse.judged.items() if score < judged.get(name, 1.0)]
    gates = [name for name in names if name in worse.gates]
    return "; ".join(metric_sentence(worse, name) for name in gates or names) or "other weights"


def _group(changes: Sequence[ScoreChange]) -> GroupComparison:
    def points(name: str) -> DriveValues:
        values = [(c, getattr(c, name)) for c in changes]
        if any(value is None for _, value in values):
            return {}
        return {(c.scenario_id, c.seed): DriveValue(c.family, 100.0 * value, c.site) for c, value in values}

    winners = [change.winner for change in changes]
    estimate, unsafe = (mean_estimate(points(name), DIFFERENCES) for name in ("difference", "unsafe_difference"))
    return GroupComparison(
        scenarios=len({change.scenario_id for change in changes}),
        drives=len(changes),
        a=mean_over_scenes(points("a")),
        b=mean_over_scenes(points("b")),
        difference=mean_over_scenes(points("difference")),
        interval=None if estimate is None else estimate.interval,
        p_value=None if estimate is None else estimate.p_value,
        least_detectable_difference=None if estimate is None else least_detectable_difference(estimate),
        unsafe_a=mean_over_scenes(points("unsafe_a")),
        unsafe_b=mean_over_scenes(points("unsafe_b")),
        unsafe_interval=None if unsafe is None else unsafe.interval,
        wins=winners.count("b"),
        losses=winners.count("a"),
        ties=winners.count("tie"),
    )
