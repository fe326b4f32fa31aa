"""Samples: a drive as rows of the schema."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from interplan_sumo.dataset.columns import Columns, stacked
from interplan_sumo.dataset.labels import Futures, GraphWay
from interplan_sumo.dataset.observation_replay import ObservationReplay
from interplan_sumo.dataset.scenario_tags import ScenarioTags
from interplan_sumo.features.tracks import nearest_agents
from interplan_sumo.features.view import EgoView
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.trace import Trace

LEAST_FUTURE_FRAMES: Final = 30
"""A sample has at least 3 s of future: DTPP's first stage."""


def sample_frames(trace: Trace, every_frames: int) -> Sequence[int]:
    """The frames that become samples: from the first on, as long as enough future is left."""
    return range(0, len(trace) - LEAST_FUTURE_FRAMES, every_frames)


def drive_samples(
    scenario: Scenario, roads: Roads, trace: Trace, *, drive: int, every_frames: int = 1,
    frames: Sequence[int] | None = None,
) -> Columns:  # fmt: skip
    """The samples of a drive, which has the number `drive`, in order of time; at `frames` only, if they are given."""
    seen_again = ObservationReplay(scenario, roads, trace)
    view = EgoView(seen_again.mission)
    futures, way = Futures(trace), GraphWay(roads, trace)
    situations = ScenarioTags(scenario, roads, trace, way)
    samples: list[dict[str, Any]] = []
    for tick in sample_frames(trace, every_frames) if frames is None else frames:
        seen = seen_again.at(tick)
        frame = view.frame(seen)
        nodes, edges = way.at(tick)
        samples.append(
            {
                **view.arrays(seen),
                "ego_future": futures.ego(tick, frame),
                "agent_futures": futures.agents(tick, nearest_agents(seen.actors, frame), frame),
                "expert_nodes": nodes,
                "expert_edges": edges,
                "situation": situations.at(tick),
                "drive": drive,
                "tick": tick,
            }
        )
    return stacked(samples)
