"""The reference planners. They use the same entry points as anyone else."""
