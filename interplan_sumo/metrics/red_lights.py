"""Red lights: did the ego drive into an intersection at red, where it could have stopped?"""

from __future__ import annotations

from typing import Any

import numpy as np

from interplan_sumo.metrics.association import Place
from interplan_sumo.metrics.circumstances import ego_doing
from interplan_sumo.metrics.facts import Facts
from interplan_sumo.metrics.metric import MetricResult, metric
from interplan_sumo.world.signals import SignalStatus

HARDEST_STOP_MPS2 = 3.5
"""Nobody need brake harder for a light that changes; about what drivers do at the onset of yellow at most."""


def first_run(facts: Facts, result: MetricResult) -> int:
    """When the front bumper crossed the first line that it should have stopped at."""
    return int(facts.time_s.searchsorted(result.detail["runs"][0]["time_s"] - 1e-6))


@metric(title="red lights", failure="red light run", lost_at=first_run)
def red_lights(facts: Facts) -> MetricResult:
    """0 if the ego ran a light that it could have stopped at with `HARDEST_STOP_MPS2`, else 1.

    What counts is where it was, and how fast, when the light turned yellow,
    or red without yellow, or in the first frame if the light was not green by then.
    """
    counted = [run for run in red_light_runs(facts) if run["stop_mps2"] <= HARDEST_STOP_MPS2]
    reason = None
    if counted:
        first = counted[0]
        frame = int(facts.time_s.searchsorted(first["time_s"] - 1e-6))
        reason = (
            f"drove through the light of connector {first['connector']} at {first['time_s']:.1f} s, "
            f"red for {first['red_s']:.1f} s, {ego_doing(facts, frame)}; {first['stop_mps2']:.1f} m/s2 "
            "would have stopped it before the line"
        )
    return MetricResult(0.0 if counted else 1.0, {"runs": counted}, reason=reason)


def red_light_runs(facts: Facts) -> list[dict[str, Any]]:
    """Every connector that the ego drove and whose light was red when its front bumper came to the connector's start.

    `stop_mps2` is the constant braking that would have stopped it at that start
    from where it was when the light ceased to be green. A bumper that comes to
    rest beyond the start does not run the light: the
    centre must follow. Where several connectors overlap and nothing tells
    which is driven, all must be red. A light that the map has but the trace
    does not counts as green, and so does whatever the ego began beyond.
    """
    found: list[dict[str, Any]] = []
    before: Place = ()
    for frame, place in enumerate(facts.places):
        if not place:
            continue
        entered = place[0] in facts.roads.connectors and (not before or before[0] in facts.roads.lanes)
        before = place
        if not entered:
            continue
        arrivals = [(connector, _bumper_arrives(facts, connector, frame)) for connector in place]
        if all(when is not None and _shows(facts, connector, when, SignalStatus.RED) for connector, when in arrivals):
            connector, when = arrivals[0]
            assert when is not None
            found.append(_run(facts, connector, when))
    return found


def _run(facts: Facts, connector: str, when: int) -> dict[str, Any]:
    """A light that was red in frame `when`, in which the bumper came to its line."""
    yellow, red = when, when
    while red > 0 and _shows(facts, connector, red - 1, SignalStatus.RED):
        red -= 1
    yellow = red
    while yellow > 0 and _shows(facts, connector, yellow - 1, SignalStatus.YELLOW):
        yellow -= 1
    steps = np.diff(facts.centre[yellow : when + 1], axis=0)
    way_m = float(np.hypot(*steps.T).sum())
    speed = float(facts.speed_mps[yellow])
    return {
        "connector": connector,
        "time_s": float(facts.time_s[when]),
        "speed_mps": float(facts.speed_mps[when]),
        "red_s": float(facts.time_s[when] - facts.time_s[red]),
        "stop_mps2": speed * speed / (2.0 * way_m) if way_m > 0.0 else float("inf"),
    }


def _bumper_arrives(facts: Facts, connector: str, frame: int) -> int | None:
    """The first frame of the stretch up to `frame` in which the front bumper is past the start; None at the outset."""
    line = facts.roads[connector].centerline
    heading = line.segment_heading_rad[0]
    front = facts.corners[: frame + 1, (0, 3)].mean(axis=1)
    past = (front - line.points[0]) @ np.array((np.cos(heading), np.sin(heading))) >= 0.0
    short = np.flatnonzero(~past)
    return int(short[-1]) + 1 if len(short) and past[frame] else None


def _shows(facts: Facts, connector: str, frame: int, status: SignalStatus) -> bool:
    return connector in facts.trace.signals[frame].with_status(status)
