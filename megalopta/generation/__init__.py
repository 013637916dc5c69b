"""Make datasets from a recipe, in one process or several."""
