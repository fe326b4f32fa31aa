"""Layer 1: recordings of real traffic, each format made a `Recording`."""
