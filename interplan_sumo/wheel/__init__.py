"""The wheel: a person drives a scenario in a browser, in real time, against the same traffic as every planner."""
