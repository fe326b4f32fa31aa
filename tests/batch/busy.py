"""A scene of dense traffic that lasts a second and a half, for tests that drive often."""

from __future__ import annotations

from interplan_sumo.scenario.scenario import LanePlace, Scenario, TrafficDemand

BUSY = Scenario(
    id="mine/0",
    family="mine",
    map="strip",
    start=LanePlace("402032", 20.0),
    start_speed_mps=12.0,
    goal=LanePlace("402032", 80.0),
    route=("40203",),
    traffic=TrafficDemand("high", "mixed"),
    duration_s=1.5,
)
