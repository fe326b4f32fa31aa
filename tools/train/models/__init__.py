"""The recipes, one module per planner; `training.recipe.find_recipe` finds them by name."""
