"""Measure speed: training, controllers, the hand IK and the QP, each beside an alternative."""
