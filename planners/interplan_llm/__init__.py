"""Language models as planners: the models in `models`, the planners beside it."""
