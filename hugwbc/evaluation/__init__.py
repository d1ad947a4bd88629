"""Measure controllers: metrics, protocols, and the comparison of controllers on one script."""
