"""Red lights: where the ego drove into an intersection at red; informs only."""

from __future__ import annotations

from typing import Any

import numpy as np

from interplan_sumo.metrics.association import Place
from interplan_sumo.metrics.facts import Facts
from interplan_sumo.world.signals import SignalStatus


def red_light_runs(facts: Facts) -> list[dict[str, Any]]:
    """Every connector that the ego drove and whose light was red when its front bumper came to the connector's start.

    A bumper that comes to rest beyond the start does not run the light: the
    centre must follow. Where several connectors overlap and nothing tells
    which is driven, all must be red. A light that the map has but the trace
    does not counts as green, and so does whatever the ego began beyond.
    """
    runs: list[dict[str, Any]] = []
    before: Place = ()
    for frame, place in enumerate(facts.places):
        if not place:
            continue
        entered = place[0] in facts.roads.connectors and (not before or before[0] in facts.roads.lanes)
        before = place
        if not entered:
            continue
        arrivals = [(connector, _arrival(facts, connector, frame)) for connector in place]
        if all(when is not None and _is_red(facts, connector, when) for connector, when in arrivals):
            connector, when = arrivals[0]
            assert when is not None
            runs.append(
                {
                    "connector": connector,
                    "time_s": float(facts.time_s[when]),
                    "speed_mps": float(facts.speed_mps[when]),
                }
            )
    return runs


def _arrival(facts: Facts, connector: str, frame: int) -> int | None:
    """The first frame of the stretch up to `frame` in which the front bumper is past the start; None at the outset."""
    line = facts.roads[connector].centerline
    heading = line.segment_heading_rad[0]
    front = facts.corners[: frame + 1, (0, 3)].mean(axis=1)
    past = (front - line.points[0]) @ np.array((np.cos(heading), np.sin(heading))) >= 0.0
    short = np.flatnonzero(~past)
    return int(short[-1]) + 1 if len(short) and past[frame] else None


def _is_red(facts: Facts, connector: str, frame: int) -> bool:
    return connector in facts.trace.signals[frame].with_status(SignalStatus.RED)
