"""Layer 0, the nouns: geometry, roads, actors, signals, the ego, trajectories and traces."""
