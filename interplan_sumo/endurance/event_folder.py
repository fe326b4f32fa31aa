"""The run folder of kept events: each is a drive of 15 s that `replay`, `report` and `score` read, and a scenario.

Workers put down traces, scenarios and scores as events happen; here they become rows.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, Final

from msgspec import Meta, Struct

from interplan_sumo.batch.custom_references import own_expert
from interplan_sumo.batch.records import (
    AppliedOverrides,
    Manifest,
    PlannerRecord,
    RecordError,
    RequestedJobs,
    Row,
    ScoreRecord,
    decode,
    encode,
)
from interplan_sumo.batch.run_folder import RunFolder, trace_place
from interplan_sumo.batch.versions import scored_versions
from interplan_sumo.endurance.records import EventKind
from interplan_sumo.errors import RunFolderError
from interplan_sumo.maps.store import MapFiles, is_shipped, load_roads
from interplan_sumo.metrics.profile import DEFAULT_PROFILE, Profile
from interplan_sumo.metrics.score import score
from interplan_sumo.scenario.files import scenario_text
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.simulation.traffic import TRAFFIC_VERSION
from interplan_sumo.world.files import replacing
from interplan_sumo.world.trace import Trace

SCENARIO_FILE: Final = "scenario.yaml"
ABOUT_FILE: Final = "event.json"
"""What is known of a kept event, beside its trace."""


class KeptEvent(Struct, frozen=True):
    """One event whose seconds are kept."""

    scenario_id: str
    scenario_hash: str
    planner: str
    planner_hash: str | None
    segment: int
    kind: EventKind
    at_s: Annotated[float, Meta(ge=0.0)]
    """Since the start of its trace."""
    trace_hash: str
    sheet: ScoreRecord
    site: str

    @property
    def place(self) -> str:
        """Where its trace lies, relative to the folder."""
        return trace_place((self.scenario_id, self.planner, 0))


def write_event(folder: Path, event: KeptEvent, scenario: Scenario) -> None:
    """Put down what is known of an event beside its trace, in a folder that is not in its place yet."""
    (folder / ABOUT_FILE).write_bytes(encode(event))
    (folder / SCENARIO_FILE).write_text(scenario_text(scenario), encoding="utf-8")


def event_score(scenario: Scenario, trace: Trace, profile: Profile, folder: Path) -> tuple[ScoreRecord, str]:
    """The score of the seconds around an event as a drive of its own, and its site."""
    roads = load_roads(scenario.map, scenario.maps_beside)
    sheet = score(trace, roads, own_expert(scenario, folder), scenario, profile)
    return ScoreRecord.of(sheet), scenario.site(roads)


def open_event_folder(folder: Path, planners: Mapping[str, PlannerRecord]) -> None:
    """Make it a run folder of these planners, or see that it is one; RunFolderError otherwise."""
    with RunFolder(folder, _manifest(planners, ())):
        pass


def collect_events(folder: Path, planners: Mapping[str, PlannerRecord], files: MapFiles) -> int:
    """Make rows of all that has been kept; how many events there are. RunFolderError if something is damaged."""
    events = sorted(_kept(folder), key=lambda event: (event.planner, event.scenario_id))
    requests = tuple(
        RequestedJobs((name,), tuple(event.scenario_id for event in events if event.planner == name), 1)
        for name in dict.fromkeys(event.planner for event in events)
    )
    with RunFolder(folder, _manifest(planners, requests)) as run:
        for event in events:
            if (event.scenario_id, event.planner, 0) not in run.done:
                run.append(_row(event, run.manifest))
        scenarios = {event.scenario_id: folder / event.place / SCENARIO_FILE for event in events}
        texts = [path.read_bytes() for _, path in sorted(scenarios.items())]
        if not is_shipped(files):
            run.keep_scenarios((), (files,))
        with replacing(folder / "scenarios.yaml") as fresh:
            fresh.write_bytes(b"---\n".join(texts))
    return len(events)


def _kept(folder: Path) -> Iterable[KeptEvent]:
    for path in sorted(folder.glob(f"traces/*/*/seed0/{ABOUT_FILE}")):
        try:
            yield decode(path.read_bytes(), KeptEvent)
        except RecordError as error:
            raise RunFolderError(f"{path} is damaged ({error}); delete its folder, and repeat the command") from None


def _manifest(planners: Mapping[str, PlannerRecord], requests: tuple[RequestedJobs, ...]) -> Manifest:
    return Manifest(
        suite="endure",
        suite_hash="",
        profile=DEFAULT_PROFILE,
        overrides=AppliedOverrides(),
        versions=scored_versions(),
        traffic_version=TRAFFIC_VERSION,
        command=(),
        created=time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        platform="",
        plan_limit_s=None,
        requests=requests,
        planners=dict(planners),
    )


def _row(event: KeptEvent, manifest: Manifest) -> Row:
    return Row(
        scenario_id=event.scenario_id,
        family="endure",
        planner=event.planner,
        seed=0,
        fault=None,
        official=False,
        overrides=AppliedOverrides(),
        perception="full",
        trace_hash=event.trace_hash,
        times_s={},
        versions=manifest.versions,
        traffic_version=manifest.traffic_version,
        reached_goal=False,
        isolated=True,
        planner_hash=event.planner_hash,
        site=event.site,
        scenario_hash=event.scenario_hash,
        trace=event.place,
        **_scored(event.sheet),
    )


def _scored(sheet: ScoreRecord) -> dict[str, Any]:
    return {name: getattr(sheet, name) for name in ("score", "metrics", "gates", "weights", "done", "unsafe", "beside")}
