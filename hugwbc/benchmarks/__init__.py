"""Measure the speed of training, controllers, hand IK and QP, each against an alternative."""
