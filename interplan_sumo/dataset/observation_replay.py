"""Observation replay: what the planner of a recorded drive was given at each step, made from the trace."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

from interplan_sumo.planner import Mission, Observation, Past
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.simulation.episode import DT_S
from interplan_sumo.simulation.history import PAST_STEPS, extrapolated_egos
from interplan_sumo.simulation.perception import Perception
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.trace import Trace


class ObservationReplay:
    """The mission and the observations of a drive, as the loop made them: the first ones with the scenario's past."""

    def __init__(self, scenario: Scenario, roads: Roads, trace: Trace) -> None:
        self.mission = Mission(roads, scenario.route, scenario.goal.pose(roads), trace.shape, DT_S)
        self._signals = trace.signals
        egos = [trace.ego.state(frame) for frame in range(len(trace))]
        self._egos = (*extrapolated_egos(roads, egos[0], DT_S, scenario.past), *egos)
        self._told = cache(trace.seen_at if trace.seen is not None else _sight(scenario, roads, trace))

    def at(self, frame: int) -> Observation:
        """The observation of one frame."""
        now = frame + PAST_STEPS
        past = Past(self._egos[frame:now], tuple(self._told(each) for each in range(frame - PAST_STEPS, frame)))
        ego = self._egos[now]
        return Observation(ego.time_s, ego, self._told(frame), self._signals[frame], past)


def _sight(scenario: Scenario, roads: Roads, trace: Trace) -> Callable[[int], Actors]:
    """What `full` perception tells at a frame, from `-PAST_STEPS` on; which depends on no other frame."""
    sight = Perception(replace(scenario, perception="full"), roads, {}, 0, DT_S)
    before, now = sight.first(trace.ego.state(0), trace.actors.at(0))
    start = (*before, now)

    def told(frame: int) -> Actors:
        return start[frame + PAST_STEPS] if frame <= 0 else sight.look(trace.ego.state(frame), trace.actors.at(frame))

    return told
