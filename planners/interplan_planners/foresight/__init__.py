"""Foresight: a planner that samples manoeuvres and speeds, looks several seconds ahead and drives what costs least."""

from interplan_planners.foresight.planner import ForesightDecision, ForesightPlanner

__all__ = ["ForesightDecision", "ForesightPlanner"]
