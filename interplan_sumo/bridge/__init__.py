"""Planners of other benchmarks at home here, and ours at home there; nothing is imported before it is asked for."""
