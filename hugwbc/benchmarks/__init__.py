"""Measure the speed of training, controllers, episodes and hand IK."""
