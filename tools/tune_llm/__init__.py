"""Tuning, offline: decisions labelled by rollout, and a small model that learns them. Not for what drives."""
