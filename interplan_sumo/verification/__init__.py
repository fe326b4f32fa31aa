"""Layer 3: proofs that scenarios are safe at the start and can be solved."""
