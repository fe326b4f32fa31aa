"""Search: drives tried one after the other, the simulator in the loop.

Each try is planned against the traffic that the tries before were recorded in;
the first one as if everybody went on as they begin. A plan is driven by the
ego's own tracker and bicycle without the simulator, then replayed through the
traffic. Some manners of driving are tried in turn, from the most comfortable
on.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, reduce
from typing import Final

import numpy as np

from interplan_sumo.maps.store import load_roads
from interplan_sumo.metrics.collisions import rows_in_contact
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.simulation.episode import DT_S
from interplan_sumo.simulation.setup import start_state
from interplan_sumo.verification.corridor import frenet_corridor
from interplan_sumo.verification.drivable_paths import (
    BEND_ROOM_M,
    NUDGE_M,
    DrivablePath,
    Side,
    Swerve,
    blocked_by,
    drivable_path,
    slow_corners,
)
from interplan_sumo.verification.observed_traffic import ObservedTraffic, recording, red_frames, walkers
from interplan_sumo.verification.planning_problem import (
    CALM,
    FIRM,
    QUICK,
    Margins,
    Pace,
    PlanningProblem,
    ProfileStart,
    SpeedProfile,
    TimeGate,
)
from interplan_sumo.verification.privileged_rollout import driven, planned_line, rounded
from interplan_sumo.verification.replay import first_frame, replay, route_distance_m
from interplan_sumo.verification.speed_lattice import cheapest_profile
from interplan_sumo.verification.yielding_prediction import entry_arc_m, yielding_profiles
from interplan_sumo.world.ego import EgoState
from interplan_sumo.world.trace import EgoTrack, Trace


@dataclass(frozen=True, slots=True)
class Style:
    """A manner of driving."""

    clearance_m: float
    ramp_m: float
    haste: float
    """These three as in `Swerve`."""
    margins: Margins
    pace: Pace
    memory: int
    """So many of the last recordings are to be free of at once."""
    yielding: bool = False
    """Whether to count on oncoming drivers to brake for the ego."""


BESIDE_SLOW_M: Final = ((20.0, 65.0), (45.0, 90.0), (70.0, 115.0), (100.0, 145.0))
"""Where, from the start on, slow vehicles may be passed."""
USUAL: Final = Margins()
TIGHT: Final = Margins(front_m=0.7, front_s=1.1, rear_m=0.8, rear_s=0.8, rear_headway_s=0.4, comfort_s=0.5)
WIDE: Final = Margins(front_m=2.5, front_s=1.5, rear_m=2.5, rear_s=1.5, rear_headway_s=1.1, comfort_s=1.4)
STYLES: Final = (
    Style(0.4, 28.0, 1.0, USUAL, CALM, 1),
    Style(0.4, 28.0, 1.0, USUAL, FIRM, 2),
    Style(0.4, 40.0, 1.5, TIGHT, QUICK, 1),
    Style(0.37, 20.0, 1.3, TIGHT, QUICK, 1),
    Style(0.6, 40.0, 1.0, WIDE, CALM, 2),
    Style(0.37, 15.0, 1.0, TIGHT, QUICK, 2),
    Style(0.4, 24.0, 1.3, TIGHT, CALM, 1, yielding=True),
    Style(0.37, 16.0, 1.0, TIGHT, CALM, 1, yielding=True),
    Style(0.37, 24.0, 1.0, USUAL, QUICK, 3),
    Style(0.4, 12.0, 1.0, TIGHT, QUICK, 3),
)
"""From the most comfortable and likely one on."""
TRIES_PER_STYLE: Final = 4
EASY_COST: Final = 5.0
"""A plan this cheap is not compared with other sides to pass on."""
LEAST_SHARE: Final = 0.65
"""Plans that get less far than this share of the reference distance are not tried."""
MOST_CHANCES, REFINEMENTS = 4, 4
"""How many oncoming drivers are put to the test, and how often a try with one is improved."""

States = tuple[EgoState, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Attempt:
    """One try: the drive, and what came of it in the traffic."""

    track: EgoTrack
    """All states; the last one lies beyond the goal line, or at the end of the last second."""
    trace: Trace
    style: Style


def attempts(scenario: Scenario, reference: Trace) -> Iterator[Attempt]:
    """Tries at a scenario, each a simulation, until nothing new comes to mind. Deterministic.

    `reference` is a drive in the same traffic without obstacles and jaywalkers:
    it shows the lights, which do not depend on the ego, and how far one may get.
    """
    search = _Search(scenario, reference)
    for style in STYLES:
        yield from search.against_yielding(style) if style.yielding else search.plainly(style)


class _Search:
    """What is known of a scenario, and the tries that come of it."""

    def __init__(self, scenario: Scenario, reference: Trace) -> None:
        roads = load_roads(scenario.map, scenario.maps_beside)
        self._scenario, self._corridor = scenario, frenet_corridor(scenario, roads)
        self._frames = round(scenario.duration_s / DT_S)
        self._first = rounded(start_state(scenario, roads))
        self._red = red_frames(self._corridor, reference.signals, self._frames)
        self._reference = reference
        self._least_m = LEAST_SHARE * route_distance_m(roads, scenario, reference.ego)
        self._recordings: list[ObservedTraffic] = []
        self._in_the_dark = True
        """Whether nobody was watched yet but after a crash; then any drive is worth a try for what it shows."""
        self._paths: dict[Swerve, tuple[DrivablePath, ...]] = {}
        self._tried: set[States] = set()

    def plainly(self, style: Style) -> Iterator[Attempt]:
        """Tries against the last recordings, on the side that promises most."""
        for _ in range(TRIES_PER_STYLE):
            found: list[tuple[SpeedProfile, States]] = []
            for others in self._known(style):
                found = self._found(others, style)
                if found:
                    break
            worth = [each for each in found if self._gets_far(each[0])] or (found if self._in_the_dark else [])
            if not worth:
                return
            yield self._attempt(min(worth, key=lambda each: each[0].cost)[1], style)

    def _known(self, style: Style) -> Iterator[ObservedTraffic]:
        """What the traffic may do, the likeliest first; the next one counts where no plan copes with it."""
        if self._recordings:
            yield reduce(ObservedTraffic.joined, self._recordings[-style.memory :])
        hindered = self._scenario.obstacles or self._scenario.jaywalkers or slow_corners(self._corridor)
        yield self._begun if hindered else self._undisturbed  # else the reference took place in this very scene
        yield self._undisturbed if hindered else self._begun

    @property
    def _latest(self) -> ObservedTraffic:
        return self._recordings[-1]

    @cached_property
    def _begun(self) -> ObservedTraffic:
        """Everybody goes on as they begin."""
        return recording(self._corridor, first_frame(self._scenario), self._frames)

    @cached_property
    def _undisturbed(self) -> ObservedTraffic:
        """Everybody drives as around the reference driver."""
        return recording(self._corridor, self._reference, self._frames)

    def _found(self, others: ObservedTraffic, style: Style) -> list[tuple[SpeedProfile, States]]:
        """New plans on every side, up to the first one that is easy."""
        found: list[tuple[SpeedProfile, States]] = []
        for paths in self._sides(style):
            planned = self._planned(paths, others, style)
            if planned is not None and planned[1] not in self._tried:
                found.append(planned)
                if planned[0].cost < EASY_COST:
                    break
        return found

    def against_yielding(self, style: Style) -> Iterator[Attempt]:
        """Tries that count on an oncoming driver to let the ego pass, each improved once the answer is known."""
        if self._scenario.traffic.oncoming == "none" or not self._recordings:
            return
        for paths in self._sides(style):
            own = paths[self._corridor.start_path]
            entry_m = entry_arc_m(self._corridor, own)
            waiting = None
            if entry_m is not None:
                waiting = self._planned(paths, self._latest, style, TimeGate(entry_m, self._frames))
            if waiting is None:
                continue
            yield self._attempt(waiting[1], style)
            problem, start = self._problem(paths, self._latest), self._start(self._first)
            for profile, gate in yielding_profiles(problem, own, start, style.margins, style.pace)[:MOST_CHANCES]:
                states: States | None = self._driven(paths, profile, (self._first,))
                for _ in range(REFINEMENTS):
                    if states is None or states in self._tried:
                        break
                    yield self._attempt(states, style)
                    refined = self._planned(paths, self._latest, style, gate)
                    states = None if refined is None else refined[1]

    def _attempt(self, states: States, style: Style) -> Attempt:
        """Replay a drive and take note of how the traffic took it."""
        self._tried.add(states)
        track = EgoTrack.of(states)
        trace = replay(self._scenario, track)
        self._recordings.append(recording(self._corridor, trace, self._frames))
        self._in_the_dark = bool(len(rows_in_contact(trace.ego.corners(trace.shape), trace.actors)))
        return Attempt(track, trace, style)

    def _gets_far(self, profile: SpeedProfile) -> bool:
        """Whether a plan gets far enough to pass."""
        return profile.to_goal or float(profile.arc_m[-1]) - self._corridor.start_m >= self._least_m

    # --- planning ------------------------------------------------------------------------------

    def _sides(self, style: Style) -> list[tuple[DrivablePath, ...]]:
        """The paths of each side on which to pass what stands on the lanes."""
        stretches = (None, *BESIDE_SLOW_M) if slow_corners(self._corridor) else (None,)
        passed = [
            min(right_m, left_m, key=abs)
            for lane_path in self._corridor.lane_paths
            for *_, right_m, left_m in blocked_by(self._corridor, lane_path, style.clearance_m, stretches[-1])
        ]
        closed = any(abs(aside_m) > NUDGE_M - max(BEND_ROOM_M) for aside_m in passed)
        sides: tuple[Side | None, ...] = (None, "left", "right") if closed else (None,)
        swerves = [
            Swerve(side, style.clearance_m, style.ramp_m, style.haste, stretch)
            for stretch in stretches
            for side in sides
        ]
        for swerve in swerves:
            if swerve not in self._paths:
                self._paths[swerve] = tuple(
                    drivable_path(self._corridor, lane_path, swerve) for lane_path in self._corridor.lane_paths
                )
        return [self._paths[swerve] for swerve in swerves]

    def _problem(self, paths: tuple[DrivablePath, ...], others: ObservedTraffic) -> PlanningProblem:
        return PlanningProblem(self._corridor, paths, others, self._red, self._frames)

    def _start(self, now: EgoState, frame: int = 0) -> ProfileStart:
        arc_m, _, _ = self._corridor.unrolled(np.array([[now.x_m, now.y_m]]))
        return ProfileStart(frame, float(arc_m[0]), now.vx_mps, self._corridor.start_path)

    def _driven(self, paths: tuple[DrivablePath, ...], profile: SpeedProfile, before: States) -> States:
        return driven(self._corridor, planned_line(self._corridor, paths, profile), profile, before, self._frames)

    def _planned(
        self, paths: tuple[DrivablePath, ...], others: ObservedTraffic, style: Style, gate: TimeGate | None = None
    ) -> tuple[SpeedProfile, States] | None:
        """A speed profile and the drive that follows it; None if there is none.

        When a jaywalker sets off depends on the ego. So the drive is planned as if
        nobody crossed, up to where the first one sets off; from there on it is
        planned anew, knowing that walk, and so on.
        """
        start, before = self._start(self._first), (self._first,)
        known: tuple[int | None, ...] = (None,) * len(self._scenario.jaywalkers)
        around = others
        for _ in range(2 * len(known) + 1):
            profile = cheapest_profile(self._problem(paths, around), start, style.margins, style.pace, gate)
            if profile is None:
                return None
            states = self._driven(paths, profile, before)
            walks, began = walkers(self._corridor, states, self._frames) if known else (None, ())
            fresh = [b for a, b in zip(known, began, strict=True) if b is not None and b != a]
            if walks is None or not fresh or min(fresh) >= len(states) - 1:
                return profile, states
            around, known = others.joined(walks), began
            before, start = states[: min(fresh) + 1], self._start(states[min(fresh)], min(fresh))
        return None
