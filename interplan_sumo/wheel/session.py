"""Session: a person drives one scenario after the other; each drive is a row of a run folder, as of any planner."""

from __future__ import annotations

import glob
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from math import isfinite
from pathlib import Path
from typing import Any, Final

from interplan_sumo.batch.jobs import Selection
from interplan_sumo.batch.options import RunOptions
from interplan_sumo.batch.records import Row
from interplan_sumo.batch.run import run
from interplan_sumo.batch.run_folder import MANIFEST, OWN_SCENARIOS, StoredRun, read_run
from interplan_sumo.batch.stored_drive import StoredDrives
from interplan_sumo.batch.traffic_files import recorded_vehicle_types
from interplan_sumo.errors import InputError, UnknownNameError
from interplan_sumo.maps.store import load_roads
from interplan_sumo.report.failure_reasons import lost_points, metric_title
from interplan_sumo.report.key_events import deciding_moment
from interplan_sumo.report.replay.drawn_scene import DrawnScene
from interplan_sumo.report.replay.page import replay_page
from interplan_sumo.scenario.route import way_ahead
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.simulation.episode import DT_S
from interplan_sumo.wheel.cockpit import Cockpit
from interplan_sumo.wheel.human_driver import Handover, HumanDriver
from interplan_sumo.wheel.page import wheel_page
from interplan_sumo.wheel.server import WheelServer, served
from interplan_sumo.world.ego import PACIFICA

HUMAN: Final = "human"
"""The planner of a row that a person drove."""
EARLIER_S: Final = 3.0
"""Before the moment that decided a drive, a person takes it over."""


@dataclass(frozen=True, slots=True)
class StoredStart:
    """From where in a stored run a person takes a drive over."""

    run: Path
    planner: str | None = None
    """None where the run holds one only."""
    at_s: float | None = None
    """None is a little before what decided the drive."""


@dataclass(frozen=True, eq=False)
class Seating:
    """What is to be driven, and where it is written."""

    options: RunOptions
    scenarios: tuple[Scenario, ...]
    out: Path
    rate: float = 1.0
    """Of time; 0.5 is slow motion."""
    handover: Handover | None = None

    @property
    def name(self) -> str:
        """Of the planner in the rows."""
        before = self.handover
        return HUMAN if before is None else f"{HUMAN} after {before.planner} at {before.frame * DT_S:.1f} s"

    @classmethod
    def of(cls, options: RunOptions, out: Path, rate: float = 1.0, start: StoredStart | None = None) -> Seating:
        """InputError for a scenario that is not there, a rate that cannot be, or a drive that cannot be taken over."""
        if not 0.1 <= rate <= 2.0:
            raise InputError(f"--speed {rate:g} is not from 0.1 to 2; 1 is real time, 0.5 slow motion")
        if out.exists() and not out.is_dir():
            raise InputError(f"cannot write the run folder {out}: it is a file; give another one as --out")
        if not options.scenarios:
            raise InputError("name what to drive: interplan-sumo drive nudge/0, or 'nudge/*' for one after the other")
        if start is None:
            found = cls(options, _chosen(options), out, rate)
        else:
            stored = read_run(start.run)
            options = _as_driven(options, stored)
            (scenario,) = _chosen(options)
            found = cls(options, (scenario,), out, rate, _handover(stored, scenario.id, start))
        driven = read_run(out).briefs if (out / MANIFEST).is_file() else {}
        left = tuple(each for each in found.scenarios if (each.id, found.name, 0) not in driven)
        if not left:
            raise InputError(f"{out} holds these drives already; give another folder as --out")
        return replace(found, scenarios=left)


@dataclass(eq=False)
class Session:
    """A person's drives, one after the other, and the pages that show them."""

    seating: Seating
    cockpit: Cockpit = field(default_factory=Cockpit)
    driven: list[tuple[Path, Row]] = field(default_factory=list[tuple[Path, Row]])
    """Run folder and row of each, in the order in which they were driven."""

    def drive(self, on_open: Callable[[WheelServer], None], port: int = 0) -> bool:
        """Serve the page and drive until all is driven or the person has had enough; whether all is.

        `on_open` is told of the server once it listens. KeyboardInterrupt (Ctrl-C) leaves what was driven.
        """
        with served(self.cockpit, wheel_page(), self.replay, port) as server:
            on_open(server)
            done = all(self._drive_scene(number) for number in range(len(self.seating.scenarios)))
            self.cockpit.tell("over")
            server.rest()
        return done

    def replay(self, number: int) -> str:
        """The page that plays the n-th drive; InputError if there is none."""
        if number >= len(self.driven):
            raise InputError(f"there is no drive {number} yet")
        folder, row = self.driven[number]
        return replay_page([StoredDrives(read_run(folder)).read(row)])

    def _drive_scene(self, number: int) -> bool:
        """Have a scenario driven, as often as the person likes; False if they want no more of any."""
        attempt = 1
        while True:
            row = self._attempt(number, attempt)
            if row is None:
                return False
            act = self._answer(row)
            if act != "again":
                return act != "quit"
            attempt += 1

    def _attempt(self, number: int, attempt: int) -> Row | None:
        """One drive to its end, begun anew as often as the person likes; None if they have had enough."""
        seating = self.seating
        scenario = seating.scenarios[number]
        out = seating.out if attempt == 1 else seating.out.with_name(f"{seating.out.name}-{attempt}")
        roads = load_roads(scenario.map, scenario.maps_beside)
        scene = DrawnScene.of(roads, scenario)
        person = HumanDriver(
            self.cockpit, scene, way_ahead(roads, scenario), rate=seating.rate, handover=seating.handover
        )  # fmt: skip
        options = replace(seating.options, planners=(seating.name,), workers=0, out=out, plan_limit_s=0.0)
        files = tuple(each for each in options.scenarios if Path(each).suffix in (".yaml", ".yml"))
        options = replace(options, scenarios=(*files, glob.escape(scenario.id)))
        key = (scenario.id, seating.name, 0)
        while True:
            self.cockpit.show_scene(**self._told(number, scene))
            try:
                row = run(options, made={seating.name: lambda: person}, command=("interplan-sumo", "drive")).rows[key]
            except KeyboardInterrupt:
                if person.left == "restart":
                    continue
                if person.left == "quit":
                    return None
                if person.left == "differs":
                    raise InputError(
                        f"the drive of {seating.name.removeprefix(f'{HUMAN} after ')} does not come again here: "
                        "another version or machine drove it; drive it again with run"
                    ) from None
                raise
            self.driven.append((out, row))
            return row

    def _told(self, number: int, scene: DrawnScene) -> dict[str, Any]:
        seating = self.seating
        return {
            **scene.fields,
            "id": seating.scenarios[number].id,
            "planner": seating.name,
            "number": number,
            "scenes": len(seating.scenarios),
            "dt_s": DT_S / seating.rate,
            "behaviours": {},
            "ego": {"length_m": PACIFICA.length_m, "width_m": PACIFICA.width_m, "wheelbase_m": PACIFICA.wheelbase_m},
        }

    def _answer(self, row: Row) -> str:
        """Tell the person how it went; what they want now."""
        self.cockpit.tell(
            "end",
            score=None if row.score is None else round(100.0 * row.score, 1),
            reached_goal=row.reached_goal,
            reasons=lost_points(row),
            metrics=[[metric_title(name), round(100.0 * value, 1)] for name, value in row.judged.items()],
            replay=len(self.driven) - 1,
        )
        while (act := self.cockpit.next_act()) not in ("again", "next", "quit"):
            pass
        return act


def _chosen(options: RunOptions) -> tuple[Scenario, ...]:
    """The scenarios, with what is changed in them."""
    return tuple(options.overrides.applied(each) for each in Selection.of(options).scenarios)


def _as_driven(options: RunOptions, stored: StoredRun) -> RunOptions:
    """The options of a run for one drive of it; InputError for one that says something else."""
    own = stored.path / OWN_SCENARIOS
    held = stored.manifest.overrides
    for name in ("suite", "density", "behaviour", "perception", "traffic", "profile"):
        if getattr(options, name) is not None:
            raise InputError(f"--from {stored.path} says what is driven; leave out {name}")
    if len(options.scenarios) != 1:
        raise InputError("name one scenario of the run to take over, such as nudge/0")
    (wanted,) = options.scenarios
    ids = {key[0] for key in stored.rows}
    if wanted not in ids:
        raise UnknownNameError(f"scenario in {stored.path}", wanted, ids)
    profile = stored.manifest.profile
    return replace(
        options,
        suite=None if own.is_file() else stored.manifest.suite,
        scenarios=(*((str(own),) if own.is_file() else ()), glob.escape(wanted)),
        density=held.density,
        behaviour=held.behaviour,
        perception=held.perception,
        traffic=recorded_vehicle_types(stored.path, stored.manifest),
        profile=None if "@" in profile else profile,
    )


def _handover(stored: StoredRun, scenario_id: str, start: StoredStart) -> Handover:
    """The drive to take over, up to the moment."""
    held = [planner for planner in stored.planners if (scenario_id, planner, 0) in stored.rows]
    if start.planner is None and len(held) > 1:
        raise InputError(f"{stored.path} holds {len(held)} planners ({', '.join(held)}); say which: --planner NAME")
    (drive,) = StoredDrives(stored).of(scenario_id, 0, () if start.planner is None else (start.planner,))
    decided_s = deciding_moment(drive).time_s if start.at_s is None else 0.0
    at_s = max(0.0, decided_s - EARLIER_S) if start.at_s is None else start.at_s
    frame = round(at_s / DT_S) if isfinite(at_s) else -1
    if not 0 <= frame < len(drive.trace.plans):
        raise InputError(
            f"--at {at_s:g} s lies outside the drive of {drive.row.planner} on {scenario_id}, "
            f"which lasts {(len(drive.trace.plans) - 1) * DT_S:.1f} s"
        )
    return Handover(drive.row.planner, drive.trace.plans[:frame], drive.trace.ego)
