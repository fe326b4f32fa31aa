"""Kilometres instead of scenes: how often a planner fails on endless trips, and how well that is known."""
