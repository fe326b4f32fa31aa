"""Layer 2: scores, as pure functions of (trace, scenario, roads)."""
