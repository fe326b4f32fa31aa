"""Submit: the drives of one planner on a whole suite become a bundle to hand in."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from msgspec import structs

from interplan_sumo.batch.bundle import MOST_BUNDLE_SEEDS, PlannerCard, plan_place, public, published, write_bundle
from interplan_sumo.batch.jobs import ScenarioSource
from interplan_sumo.batch.records import JobKey, PlannerRecord, RequestedJobs
from interplan_sumo.batch.run_folder import OWN_SCENARIOS, StoredRun, trace_place
from interplan_sumo.errors import InputError, UnknownNameError, clean_line
from interplan_sumo.planner import split_spec
from interplan_sumo.world.files import file_hash
from interplan_sumo.world.plans import plan_bytes
from interplan_sumo.world.trace import read_plans


@dataclass(frozen=True, slots=True)
class Submitted:
    """What was written."""

    path: Path
    card: PlannerCard
    suite: str
    drives: int
    sha256: str
    bytes: int


def submit(run: StoredRun, out: Path, planner: str | None = None, card: PlannerCard | None = None) -> Submitted:
    """Write the bundle of a planner of a run (its only one, if none is named); the same run gives the same bytes.

    InputError if the run is not one of a whole suite as it is, with a score and
    the plans of every drive.
    """
    planner = _planner(run, planner)
    scenarios, seeds = _scenarios(run), _seeds(run, planner)
    keys = [(scenario, planner, seed) for scenario in scenarios for seed in range(seeds)]
    _check_whole(run, planner, keys)
    card = card or PlannerCard()
    if not card.name:
        card = structs.replace(card, name=clean_line(public(split_spec(planner)[0]), 80))
    held = run.manifest.planners.get(planner)
    manifest = structs.replace(
        run.manifest,
        command=(),
        requests=(RequestedJobs((card.name,), scenarios, seeds),),
        planners={} if held is None else {card.name: _without_folders(held)},
    )
    rows = [run.rows[key] for key in sorted(keys)]
    places = {plan_place(row.key): run.path / trace_place(row.key) for row in rows if row.trace is not None}
    write_bundle(out, card, manifest, (published(row, card.name) for row in rows), _Plans(places))
    return Submitted(out, card, manifest.suite, len(rows), file_hash(out), out.stat().st_size)


def _planner(run: StoredRun, planner: str | None) -> str:
    if planner is not None:
        if planner not in run.planners:
            raise UnknownNameError(f"planner in {run.path}", planner, run.planners)
        return planner
    if len(run.planners) != 1:
        raise InputError(f"{run.path} holds {len(run.planners)} planners; name the one to hand in with --planner")
    return run.planners[0]


def _scenarios(run: StoredRun) -> tuple[str, ...]:
    """The ids of the whole suite; InputError if the run changed or chose anything."""
    manifest = run.manifest
    if manifest.overrides:
        changes = ", ".join(f"{key}={value}" for key, value in manifest.overrides.texts().items())
        raise InputError(f"{run.path} was driven with {changes}; hand in a suite as it is")
    if "@" in manifest.profile:
        raise InputError(
            f"{run.path} was scored by a profile of your own, {manifest.profile}; hand in one by a shipped one"
        )
    own = run.path / OWN_SCENARIOS
    source = ScenarioSource.of(None, (str(own),)) if own.is_file() else ScenarioSource.of(manifest.suite, ())
    if source.hash != manifest.suite_hash:
        raise InputError(f"{run.path}: suite {manifest.suite} has changed since it was driven; drive it again")
    return tuple(scenario.id for scenario in source.scenarios)


def _seeds(run: StoredRun, planner: str) -> int:
    """How many are handed in: all, or as many as a judge takes."""
    return min(MOST_BUNDLE_SEEDS, max(each.seeds for each in run.manifest.requests if planner in each.planners))


def _check_whole(run: StoredRun, planner: str, keys: Sequence[JobKey]) -> None:
    briefs = run.briefs
    left = [key for key in keys if key not in briefs or briefs[key].score is None]
    if left:
        scenario, _, seed = left[0]
        raise InputError(
            f"{run.path}: {len(left)} of the {len(keys)} drives of {planner} on all of {run.manifest.suite} have no "
            f"score, first {scenario}, seed {seed}; a part of a suite is no result: run the rest first"
        )


def _without_folders(planner: PlannerRecord) -> PlannerRecord:
    return PlannerRecord(planner.hash, {clean_line(public(name)): digest for name, digest in planner.files.items()})


class _Plans(Mapping[str, bytes]):
    """The plans of drives by their places in the bundle, read when they are asked for."""

    def __init__(self, traces: Mapping[str, Path]) -> None:
        self._traces = traces

    def __getitem__(self, place: str) -> bytes:
        return plan_bytes(read_plans(self._traces[place]))

    def __iter__(self) -> Iterator[str]:
        return iter(self._traces)

    def __len__(self) -> int:
        return len(self._traces)
