"""Observation replay: what the planner of a recorded drive was given at each step, made from the trace."""

from __future__ import annotations

from interplan_sumo.planner import Mission, Observation, Past
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.simulation.episode import DT_S
from interplan_sumo.simulation.history import PAST_STEPS, extrapolated_past
from interplan_sumo.simulation.visibility import occluding_box, visible
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.trace import Trace


class ObservationReplay:
    """The mission and the observations of a drive, as the loop made them: the first ones with the scenario's past."""

    def __init__(self, scenario: Scenario, roads: Roads, trace: Trace) -> None:
        self.mission = Mission(roads, scenario.route, scenario.goal.pose(roads), trace.shape, DT_S)
        self._signals = trace.signals
        occluder = occluding_box(scenario, roads)
        egos = [trace.ego.state(frame) for frame in range(len(trace))]
        actors = [visible(trace.actors.at(frame), ego, occluder) for frame, ego in enumerate(egos)]
        past = extrapolated_past(roads, egos[0], actors[0], DT_S, scenario.past)
        self._egos = (*past.egos, *egos)
        self._actors = (*past.actors, *actors)

    def at(self, frame: int) -> Observation:
        """The observation of one frame."""
        now = frame + PAST_STEPS
        past = Past(self._egos[frame:now], self._actors[frame:now])
        ego = self._egos[now]
        return Observation(ego.time_s, ego, self._actors[now], self._signals[frame], past)
