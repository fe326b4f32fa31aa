"""Layer 1: how the ego follows a trajectory."""
