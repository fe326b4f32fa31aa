"""Layer 3: tables for people and for programs."""
