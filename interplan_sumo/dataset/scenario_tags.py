"""Scenario tags: what a sample shows, told from what the ego does next and what is ahead, to balance training by."""

from __future__ import annotations

from functools import cached_property
from typing import Final

import numpy as np

from interplan_sumo.dataset.labels import GraphWay
from interplan_sumo.features.lane_graph import lane_graph
from interplan_sumo.features.schema import FUTURE_FRAMES, SITUATIONS
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.geometry import wrap_angle
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.signals import SignalStatus
from interplan_sumo.world.trace import Trace

STANDS_MPS: Final = 0.5
"""Slower is standing."""
STARTS_MPS: Final = 2.0
"""Who stands and is faster than this within the future starts."""
SOON_FRAMES: Final = 50
"""A lane change or a turn is made within 5 s; what comes later is another sample's."""
SINCE_FRAMES: Final = 10
"""A lane change goes on for 1 s after the rear axle has come to the other lane."""
TURN_RAD: Final = float(np.radians(25.0))
LIGHT_M: Final = 50.0
"""As far ahead a red light matters: the way to stop from 13 m/s without haste."""
LEADER_M: Final = 40.0
BESIDE_M: Final = 2.0
"""A leader is nearer than the one ahead and than the other to the side, as in the suite of ordinary driving."""
ALONG_RAD: Final = float(np.radians(45.0))
_STOP: Final = (SignalStatus.RED, SignalStatus.YELLOW)


class ScenarioTags:
    """What happens in one drive."""

    def __init__(self, scenario: Scenario, roads: Roads, trace: Trace, way: GraphWay) -> None:
        self._roads, self._trace = roads, trace
        self._blocks = frozenset(scenario.route)
        self._nodes = way.nodes

    def at(self, frame: int) -> int:
        """Place in `SITUATIONS` of what happens from a frame on: of all that is so the one that stands last there."""
        return SITUATIONS.index(self._name(frame))

    def _name(self, frame: int) -> str:
        ego = self._trace.ego
        ahead = slice(frame, frame + FUTURE_FRAMES + 1)
        soon = slice(frame, frame + SOON_FRAMES + 1)
        speed, heading = ego.vx_mps[ahead], np.unwrap(ego.heading_rad[soon])
        stands = speed[0] < STANDS_MPS
        if self._changes[max(0, frame - SINCE_FRAMES) : frame + SOON_FRAMES].any():
            return "lane_change"
        if abs(heading[-1] - heading[0]) > TURN_RAD:
            return "turning"
        if stands:
            return "starting" if speed.max() > STARTS_MPS else "standing"
        if self._comes_to_red(frame):
            return "red_light"
        if speed.min() < STANDS_MPS:
            return "stopping"
        return "following" if self._follows(frame) else "free"

    @cached_property
    def lanes(self) -> tuple[str, ...]:
        """(F,) lane or connector under the rear axle in each frame, "" where there is none."""
        ids = lane_graph(self._roads).node_lane_ids
        return tuple("" if node < 0 else str(ids[node]) for node in self._nodes.tolist())

    @cached_property
    def on_way(self) -> np.ndarray:
        """(F,) whether the rear axle is on a lane of the route."""
        return np.array([lane != "" and self._roads[lane].roadblock_id in self._blocks for lane in self.lanes])

    @cached_property
    def _changes(self) -> np.ndarray:
        """(F,) whether the ego is on a neighbour lane in the next frame."""
        changed = [self._beside(here, there) for here, there in zip(self.lanes, self.lanes[1:], strict=False)]
        return np.array([*changed, False])

    def _beside(self, here: str, there: str) -> bool:
        if here == there or here not in self._roads.lanes:
            return False
        beside = (self._roads.left_of(here), self._roads.right_of(here))
        return any(lane is not None and lane.id == there for lane in beside)

    def _comes_to_red(self, frame: int) -> bool:
        lane = self.lanes[frame]
        if lane not in self._roads.lanes:
            return False
        line, ego = self._roads[lane].centerline, self._trace.ego
        if line.length_m - line.project_point(float(ego.x_m[frame]), float(ego.y_m[frame]))[0] > LIGHT_M:
            return False
        ways = {way for way in self._roads.outgoing(lane) if self._roads[way].roadblock_id in self._blocks}
        signals = self._trace.signals[frame]
        return any(
            connector in ways and status in _STOP
            for connector, status in zip(signals.connector_ids, signals.status.tolist(), strict=True)
        )

    def _follows(self, frame: int) -> bool:
        ego, shape = self._trace.ego, self._trace.shape
        actors = self._trace.actors.at(frame)
        dx, dy = actors.x_m - ego.x_m[frame], actors.y_m - ego.y_m[frame]
        cosine, sine = np.cos(ego.heading_rad[frame]), np.sin(ego.heading_rad[frame])
        gap_m = cosine * dx + sine * dy - (shape.length_m + actors.length_m) / 2.0
        along = np.abs(wrap_angle(actors.heading_rad - ego.heading_rad[frame])) < ALONG_RAD
        beside = np.abs(cosine * dy - sine * dx) < BESIDE_M
        leads = (actors.kind == ActorKind.VEHICLE) & along & beside & (gap_m > -1.0) & (gap_m < LEADER_M)
        return bool(leads.any())
