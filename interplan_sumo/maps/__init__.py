"""Layer 1: maps in and out, and the SUMO networks made from them."""
