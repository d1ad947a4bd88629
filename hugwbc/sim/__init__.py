"""The H1 in MuJoCo: on a plane or a height field."""

from hugwbc.sim.simulation import SensorNoise, Simulation, noisy_simulation
from hugwbc.sim.terrain import HeightField, rough_terrain

__all__ = ["HeightField", "SensorNoise", "Simulation", "noisy_simulation", "rough_terrain"]
