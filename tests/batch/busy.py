"""Scenes on the plainest map, for tests that drive often: one without traffic, and a short one with much of it."""

from __future__ import annotations

from dataclasses import replace

from interplan_sumo.scenario.scenario import LanePosition, Scenario, TrafficDemand

PLAIN = Scenario(
    id="mine/0",
    family="mine",
    map="strip",
    start=LanePosition("402032", 20.0),
    start_speed_mps=12.0,
    goal=LanePosition("402032", 80.0),
    route=("40203",),
)
"""Nobody else on the road, and the usual duration."""
BUSY = replace(PLAIN, traffic=TrafficDemand("high", "mixed"), duration_s=1.5)
