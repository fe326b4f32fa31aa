"""Observation replay: what the planner of a recorded drive was given at each step, made from the trace."""

from __future__ import annotations

from dataclasses import replace

from interplan_sumo.planner import Mission, Observation, Past
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.simulation.episode import DT_S
from interplan_sumo.simulation.history import PAST_STEPS, extrapolated_egos
from interplan_sumo.simulation.perception import Perception
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.trace import Trace


class ObservationReplay:
    """The mission and the observations of a drive, as the loop made them: the first ones with the scenario's past."""

    def __init__(self, scenario: Scenario, roads: Roads, trace: Trace) -> None:
        self.mission = Mission(roads, scenario.route, scenario.goal.pose(roads), trace.shape, DT_S)
        self._signals = trace.signals
        egos = [trace.ego.state(frame) for frame in range(len(trace))]
        self._egos = (*extrapolated_egos(roads, egos[0], DT_S, scenario.past), *egos)
        if trace.seen is not None:
            self._actors = tuple(trace.seen_at(frame) for frame in range(-PAST_STEPS, len(trace)))
            return
        sight = Perception(replace(scenario, perception="full"), roads, {}, 0, DT_S)
        before, now = sight.first(egos[0], trace.actors.at(0))
        after = (sight.look(egos[frame], trace.actors.at(frame)) for frame in range(1, len(trace)))
        self._actors = (*before, now, *after)

    def at(self, frame: int) -> Observation:
        """The observation of one frame."""
        now = frame + PAST_STEPS
        past = Past(self._egos[frame:now], self._actors[frame:now])
        ego = self._egos[now]
        return Observation(ego.time_s, ego, self._actors[now], self._signals[frame], past)
