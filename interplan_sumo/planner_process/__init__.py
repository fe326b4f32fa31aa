"""Planners in processes of their own, and what is said between them and the benchmark (docs/planner_protocol.md)."""
