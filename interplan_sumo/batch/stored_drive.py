"""Stored drives: a row of a run folder with all that its score came from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from interplan_sumo.batch.custom_references import own_expert
from interplan_sumo.batch.overrides import Overrides
from interplan_sumo.batch.records import Row
from interplan_sumo.batch.run_folder import OWN_SCENARIOS, StoredRun
from interplan_sumo.errors import InputError, UnknownNameError, check_names
from interplan_sumo.maps.store import load_roads
from interplan_sumo.metrics.profile import Profile, stored_profile
from interplan_sumo.metrics.score import ScoreSheet, score
from interplan_sumo.scenario.files import read_scenarios
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.scenario.suite import expert, find_scenario
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.trace import EgoTrack, Trace


@dataclass(frozen=True, eq=False)
class StoredDrive:
    """A drive of a run folder. One that ended in a planner's fault has the frames up to it."""

    row: Row
    scenario: Scenario
    """As it was driven: with the run's overrides."""
    trace: Trace
    run_folder: Path
    official: bool
    """Whether the scenario belongs to a suite; one's own has its expert in the run folder."""
    profile_name: str
    """Under which the run scored it."""

    @property
    def roads(self) -> Roads:
        """The map, from a small cache."""
        return load_roads(self.scenario.map, self.scenario.maps_beside)

    @cached_property
    def expert(self) -> EgoTrack:
        """The drive that progress is measured against; opens SUMO where it is not there yet."""
        return expert(self.scenario) if self.official else own_expert(self.scenario, self.run_folder)

    @property
    def profile(self) -> Profile:
        """What the run scored it by; UnknownNameError if that is not installed here."""
        return stored_profile(self.profile_name, self.run_folder)

    def sheet(self, profile: str | Profile) -> ScoreSheet:
        """The score with every metric's series, computed anew."""
        return score(self.trace, self.roads, self.expert, self.scenario, profile)


class StoredDrives:
    """Reads the drives of a run folder, one at a time."""

    def __init__(self, run: StoredRun) -> None:
        self.run = run
        self.own = own_scenarios(run)
        held = run.manifest.overrides
        self._overrides = Overrides(held.density, held.behaviour, held.perception)

    def scenario(self, row: Row) -> Scenario:
        """The scenario of a row as it was driven; InputError if it is not the same any more."""
        found = self.own.get(row.scenario_id) or find_scenario(row.scenario_id)
        scenario = self._overrides.applied(found)
        if scenario.hash() != row.scenario_hash:
            raise InputError(
                f"{self.run.path}: scenario {scenario.id} has changed since it was driven; "
                "use the version that drove it"
            )
        return scenario

    def read(self, row: Row) -> StoredDrive:
        """The drive of a row; InputError if it left no trace, or scenario or trace are not those that were driven."""
        scenario = self.scenario(row)
        if row.trace is None:
            why = f": {row.fault.kind} fault, {row.fault.message}" if row.fault else ""
            raise InputError(
                f"{self.run.path}: the drive of {row.planner} on {scenario.id}, seed {row.seed}, left no trace{why}"
            )
        folder = self.run.path / row.trace
        trace = Trace.read(folder)
        if trace.hash() != row.trace_hash:
            raise InputError(
                f"{folder}: the trace is not the one that was driven; "
                "delete its line in results.jsonl and repeat the run"
            )
        official = row.scenario_id not in self.own
        return StoredDrive(row, scenario, trace, self.run.path, official, self.run.manifest.profile)

    def of(
        self, scenario_id: str, seed: int = 0, planners: Sequence[str] = (), most: int | None = None
    ) -> tuple[StoredDrive, ...]:
        """The drives of these planners on a scenario, in this order; without names those of the first `most`.

        UnknownNameError for a scenario or planner that the run does not have,
        InputError for a seed that it does not have, or a drive that left no trace.
        """
        run = self.run
        driven = [key for key in run.rows if key[0] == scenario_id]
        if not driven:
            raise UnknownNameError(f"scenario in {run.path}", scenario_id, {key[0] for key in run.rows})
        found = {key[1]: key for key in driven if key[2] == seed}
        if not found:
            seeds = ", ".join(map(str, sorted({key[2] for key in driven})))
            raise InputError(f"{run.path} has no drive of {scenario_id} with seed {seed}; it has seed {seeds}")
        check_names(f"planner in {run.path} that drove {scenario_id} with seed {seed}", planners, found)
        in_order = [name for name in dict.fromkeys((*run.planners, *found)) if name in found]
        return tuple(self.read(run.rows[found[name]]) for name in dict.fromkeys(planners) or in_order[:most])


def own_scenarios(run: StoredRun) -> dict[str, Scenario]:
    """The scenarios of a run by id, if they belong to no suite; nothing for a run of a suite."""
    path = run.path / OWN_SCENARIOS
    return {scenario.id: scenario for scenario in read_scenarios(path)} if path.is_file() else {}
