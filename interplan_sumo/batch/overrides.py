"""Overrides: what a run changes in its scenarios."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from interplan_sumo.batch.records import AppliedOverrides
from interplan_sumo.errors import InputError
from interplan_sumo.scenario.scenario import Density, Scenario
from interplan_sumo.world.files import file_hash


@dataclass(frozen=True, slots=True)
class Overrides:
    """What the user changed in the official scenarios; nothing by default."""

    density: Literal["low", "medium", "high"] | None = None
    behaviour: str | None = None
    perception: str | None = None
    vehicle_types: Path | None = None
    """A vehicle-type file of the user's instead of the scenario's."""

    def __bool__(self) -> bool:
        return self != Overrides()

    def canonical(self) -> AppliedOverrides:
        """For manifests and rows: equal where and only where the runs mean the same.

        A vehicle-type file counts by name and content, wherever it lies.
        """
        traffic = None
        if self.vehicle_types is not None:
            try:
                digest = file_hash(self.vehicle_types)
            except OSError as error:
                raise InputError(f"cannot read the vehicle-type file {self.vehicle_types}: {error.strerror}") from None
            traffic = f"{self.vehicle_types.name} sha256:{digest[:16]}"
        return AppliedOverrides(self.density, self.behaviour, self.perception, traffic)

    def applied(self, scenario: Scenario) -> Scenario:
        """The scenario with them; one without moving traffic has none that could be changed."""
        if self.perception is not None:
            scenario = replace(scenario, perception=self.perception)
        traffic = scenario.traffic
        if not (scenario.has_flow or scenario.vehicles):
            return scenario
        density = self.density

        def changed(before: Density) -> Density:
            return before if density is None or before == "none" else density

        behaviour = traffic.behaviour if self.behaviour is None else self.behaviour
        return replace(
            scenario,
            traffic=replace(
                traffic,
                density=changed(traffic.density),
                oncoming=changed(traffic.oncoming),
                behaviour=behaviour,  # type: ignore[arg-type]  # any file in routes/
            ),
        )
