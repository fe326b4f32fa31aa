"""Layer 1: scenarios as data, one module per family, and the suites."""
