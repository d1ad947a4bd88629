"""Recipes: a declarative file from which one command makes a policy, with the ancestry of everything it writes."""
