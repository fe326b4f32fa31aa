"""Waypoints: a language model writes down where the car shall be, in the manner of GPT-Driver."""
