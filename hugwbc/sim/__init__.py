"""The H1 in MuJoCo: on a plane or a height field."""

from hugwbc.sim.simulation import SensorNoise, Simulation, noisy_simulation
from hugwbc.sim.terrain import HeightField, LevelGround, level_terrain, rough_terrain

__all__ = [
    "HeightField",
    "LevelGround",
    "SensorNoise",
    "Simulation",
    "level_terrain",
    "noisy_simulation",
    "rough_terrain",
]
