"""Datasets made from a recipe, by one process or several."""
