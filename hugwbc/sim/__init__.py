"""The H1 in MuJoCo: on a plane or a height field."""

from hugwbc.sim.simulation import SensorNoise, Simulation
from hugwbc.sim.terrain import HeightField, rough_terrain

__all__ = ["HeightField", "SensorNoise", "Simulation", "rough_terrain"]
