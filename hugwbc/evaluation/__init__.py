"""Measure controllers: metrics, experiments, and the comparison of controllers on one script."""
