"""Layer 3: many episodes: jobs, worker processes, run folders."""
