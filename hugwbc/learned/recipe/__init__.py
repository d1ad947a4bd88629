"""Recipes: a policy made by one file, stage by stage, and what its files say of how they were made."""
