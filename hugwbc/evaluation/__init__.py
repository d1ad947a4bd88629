"""Measure controllers: tracking errors, the paper's protocols, and the comparison of controllers on one script."""
