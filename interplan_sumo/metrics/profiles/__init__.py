"""Scoring profiles as data: each YAML file here is one, read by `interplan_sumo.metrics.profile`."""
