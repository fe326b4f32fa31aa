"""Layer 2: background traffic on SUMO and the closed loop. Read episode.py first."""
