"""Recipes: a policy made by one file, stage by stage, with a record in its files."""
