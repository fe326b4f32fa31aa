"""Search: drives tried one after the other, the simulator in the loop.

Each try is planned against the traffic that the try before was recorded in: at
first as if everybody went on as they begin, then knowing how they took the
ego's last drive. A plan is driven by the ego's own tracker and bicycle without
the simulator, then replayed through the traffic.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import reduce

import numpy as np

from interplan_sumo.maps.store import load_roads
from interplan_sumo.proving.course import course
from interplan_sumo.proving.courtesy import courteous, entry_arc_m
from interplan_sumo.proving.occupancy import Margins
from interplan_sumo.proving.recording import Recording, recording, red_frames, walkers
from interplan_sumo.proving.reference import route_distance_m
from interplan_sumo.proving.replay import first_frame, replay
from interplan_sumo.proving.script import driven, path
from interplan_sumo.proving.timing import (
    CALM_PACE,
    FIRM_PACE,
    QUICK_PACE,
    STEP_FRAMES,
    Gate,
    Pace,
    Start,
    Timing,
    timing,
)
from interplan_sumo.proving.ways import Side, Swerve, Way, blocked_by, way
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.simulation.episode import DT_S
from interplan_sumo.simulation.setup import start_state
from interplan_sumo.world.ego import EgoState
from interplan_sumo.world.trace import EgoTrack, Trace

TRIES_PER_STYLE = 4
EASY_COST = 5.0
"""A plan this cheap is not compared with other manners to pass."""


@dataclass(frozen=True, slots=True)
class Style:
    """How one tries to drive."""

    clearance_m: float
    ramp_m: float
    haste: float
    margins: Margins
    pace: Pace
    memory: int
    """So many of the last recordings are to be free of at once."""
    courtesy: bool = False
    """Whether to count on oncoming drivers to brake for the ego."""


CALM = Margins()
TIGHT = Margins(front_m=0.7, front_s=1.1, rear_m=0.8, rear_s=0.6, comfort_s=0.5)
WIDE = Margins(front_m=2.5, front_s=1.5, rear_m=2.5, rear_s=1.5, comfort_s=1.4)
LEAST_SHARE = 0.65
"""Plans that get less far than this share of the reference distance are not tried."""
MOST_CHANCES, REFINEMENTS = 4, 4
"""How many oncoming drivers are put to the test, and how often a try with one is improved."""
STYLES: tuple[Style, ...] = (
    Style(0.4, 28.0, 1.0, CALM, CALM_PACE, 1),
    Style(0.4, 28.0, 1.0, CALM, FIRM_PACE, 2),
    Style(0.3, 40.0, 1.5, TIGHT, QUICK_PACE, 1),
    Style(0.3, 20.0, 1.3, TIGHT, QUICK_PACE, 1),
    Style(0.6, 40.0, 1.0, WIDE, CALM_PACE, 2),
    Style(0.3, 15.0, 1.0, TIGHT, QUICK_PACE, 2),
    Style(0.3, 24.0, 1.3, TIGHT, CALM_PACE, 1, courtesy=True),
    Style(0.3, 16.0, 1.0, TIGHT, CALM_PACE, 1, courtesy=True),
    Style(0.2, 24.0, 1.0, CALM, QUICK_PACE, 3),
    Style(0.4, 12.0, 1.0, TIGHT, QUICK_PACE, 3),
)
"""From the most comfortable and likely one on."""


@dataclass(frozen=True, slots=True, eq=False)
class Attempt:
    """One try: the drive, and what came of it in the traffic."""

    track: EgoTrack
    """All states, one more than the trace has frames unless the goal line ended the drive."""
    trace: Trace
    style: Style


def attempts(scenario: Scenario, reference: Trace) -> Iterator[Attempt]:
    """Tries at a scenario, each a simulation, until nothing new comes to mind. Deterministic.

    `reference` is a drive in the same traffic without obstacles and jaywalkers:
    it shows the lights, which do not depend on the ego, and how far one may get.
    """
    search = _Search(scenario, reference)
    for style in STYLES:
        yield from search.courteously(style) if style.courtesy else search.plainly(style)


class _Search:
    def __init__(self, scenario: Scenario, reference: Trace) -> None:
        self._scenario = scenario
        self._course = course(scenario, load_roads(scenario.map))
        self._frames = round(scenario.duration_s / DT_S)
        self._start = start_state(scenario, self._course.roads)
        self._red = red_frames(self._course, reference.signals, self._frames)
        self._guess = recording(self._course, self._first_guess(reference), self._frames)
        self._least_m = LEAST_SHARE * route_distance_m(self._course.roads, scenario, reference.ego)
        self._recordings: list[Recording] = []
        self._ways: dict[Swerve, tuple[Way, ...]] = {}
        self._driven: set[tuple[EgoState, ...]] = set()

    def _first_guess(self, reference: Trace) -> Trace:
        """What to plan the first try against: the reference where it took place in this very scene."""
        hindered = self._scenario.obstacles or self._scenario.jaywalkers
        return first_frame(self._scenario) if hindered else reference

    def plainly(self, style: Style) -> Iterator[Attempt]:
        """Tries against the last recordings, in the manner that promises most."""
        for _ in range(TRIES_PER_STYLE):
            recent = self._recordings[-style.memory :] or [self._guess]
            others = reduce(Recording.joined, recent)
            found: list[tuple[float, tuple[EgoState, ...]]] = []
            for ways in self._manoeuvres(style):
                planned = self._planned(ways, others, style)
                if planned is not None and planned[1] not in self._driven and self._is_worth(planned[0]):
                    found.append((planned[0].cost, planned[1]))
                    if planned[0].cost < EASY_COST:
                        break
            if not found:
                return
            yield self._attempt(min(found, key=lambda each: each[0])[1], style)

    def courteously(self, style: Style) -> Iterator[Attempt]:
        """Tries that count on an oncoming driver to let the ego pass, each refined once the answer is known."""
        for ways in self._manoeuvres(style):
            entry_m = entry_arc_m(self._course, ways[self._course.start_track])
            if entry_m is None or self._course.scenario.traffic.oncoming == "none":
                continue
            never = Gate(entry_m, self._frames)
            waiting = self._planned(ways, self._recordings[-1], style, never)
            if waiting is None:
                continue
            attempt = self._attempt(waiting[1], style)
            yield attempt
            base = self._recordings[-1]

            def plan(others: Recording, gate: Gate, ways: tuple[Way, ...] = ways) -> Timing | None:
                return self._timing(ways, others, style, gate)

            steps = self._frames // STEP_FRAMES
            chances = courteous(self._course, ways[self._course.start_track], base, steps, plan)
            for guessed, gate in chances[:MOST_CHANCES]:
                states = self._driven_by(ways, guessed)
                for _ in range(REFINEMENTS):
                    if states is None or states in self._driven:
                        break
                    yield self._attempt(states, style)
                    refined = self._planned(ways, self._recordings[-1], style, gate)
                    states = None if refined is None else refined[1]

    def _is_worth(self, plan: Timing) -> bool:
        """Whether a plan gets far enough; the first one shows at least what the others do."""
        advanced_m = float(plan.arc_m[-1]) - self._course.start_m
        return plan.to_goal or advanced_m >= self._least_m or not self._recordings

    def _attempt(self, states: tuple[EgoState, ...], style: Style) -> Attempt:
        """Replay a drive and take note of how the traffic took it."""
        self._driven.add(states)
        track = EgoTrack.of(states)
        trace = replay(self._scenario, track)
        self._recordings.append(recording(self._course, trace, self._frames))
        return Attempt(track, trace, style)

    def _manoeuvres(self, style: Style) -> list[tuple[Way, ...]]:
        """The ways of each manner to pass what stands on the tracks."""
        closed = any(blocked_by(self._course, track, style.clearance_m) for track in self._course.tracks)
        sides: tuple[Side | None, ...] = (None, "left", "right") if closed else (None,)
        swerves = [Swerve(side, style.clearance_m, style.ramp_m, style.haste) for side in sides]
        for swerve in swerves:
            if swerve not in self._ways:
                self._ways[swerve] = tuple(way(self._course, track, swerve) for track in self._course.tracks)
        return [self._ways[swerve] for swerve in swerves]

    def _timing(
        self,
        ways: tuple[Way, ...],
        others: Recording,
        style: Style,
        gate: Gate | None = None,
        start: Start | None = None,
    ) -> Timing | None:
        first = start or Start(0, self._course.start_m, self._start.vx_mps, self._course.start_track)
        return timing(self._course, ways, others, self._red, first, self._frames, style.margins, style.pace, gate)

    def _driven_by(
        self, ways: tuple[Way, ...], plan: Timing, before: tuple[EgoState, ...] = ()
    ) -> tuple[EgoState, ...]:
        return driven(self._course, path(self._course, ways, plan), plan, before or (self._start,), self._frames)

    def _planned(
        self, ways: tuple[Way, ...], others: Recording, style: Style, gate: Gate | None = None
    ) -> tuple[Timing, tuple[EgoState, ...]] | None:
        """A timing and the drive that follows it; None if there is none.

        When a jaywalker sets off depends on the ego. So the drive is planned as if
        nobody crossed, up to where the first one sets off; from there on it is
        planned anew, knowing that walk, and so on.
        """
        plan = self._timing(ways, others, style, gate)
        if plan is None:
            return None
        states = self._driven_by(ways, plan)
        known: tuple[int | None, ...] = (None,) * len(self._scenario.jaywalkers)
        for _ in range(len(known) + 1 if known else 0):
            walks, began = walkers(self._course, states, self._frames)
            fresh = [b for a, b in zip(known, began, strict=True) if b is not None and b != a]
            if not fresh:
                break
            known = began
            at = min(min(fresh), len(states) - 1)
            now = states[at]
            arc, _, _ = self._course.unrolled(np.array([[now.x_m, now.y_m]]))
            start = Start(at, float(arc[0]), now.vx_mps, self._course.start_track)
            plan = self._timing(ways, others.joined(walks), style, gate, start)
            if plan is None:
                return None
            states = self._driven_by(ways, plan, states[: at + 1])
        return plan, states
