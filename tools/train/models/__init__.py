"""The recipes, one module per planner; `tools.train.recipe.find_recipe` finds them by name."""
