"""Simulation of the H1 in MuJoCo, on a plane or a height field."""

from hugwbc.sim.forces import Disturber, Force
from hugwbc.sim.sensors import SensorNoise
from hugwbc.sim.simulation import Simulation, noisy_simulation
from hugwbc.sim.terrain import HeightField, LevelGround, level_terrain, rough_terrain
from hugwbc.sim.variation import Variation

__all__ = [
    "Disturber",
    "Force",
    "HeightField",
    "LevelGround",
    "SensorNoise",
    "Simulation",
    "Variation",
    "level_terrain",
    "noisy_simulation",
    "rough_terrain",
]
