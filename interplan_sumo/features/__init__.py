"""Features: what a planner sees, as arrays in the ego's frame, the same in training and in `plan()`."""
