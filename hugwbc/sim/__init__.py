"""Simulation of a robot: in MuJoCo on a plane or a height field, with objects, or in PhysX on a plane."""

from hugwbc.sim.actuators import Actuators
from hugwbc.sim.arena import Arena
from hugwbc.sim.engine import Engine
from hugwbc.sim.forces import Disturber, Force
from hugwbc.sim.robot_model import Variation
from hugwbc.sim.scenes import Scene, load_scene
from hugwbc.sim.sensors import SensorProfile
from hugwbc.sim.simulation import Simulation
from hugwbc.sim.terrain import Ground, HeightField, LevelGround, level_terrain, rough_terrain

__all__ = [
    "Actuators",
    "Arena",
    "Disturber",
    "Engine",
    "Force",
    "Ground",
    "HeightField",
    "LevelGround",
    "Scene",
    "SensorProfile",
    "Simulation",
    "Variation",
    "level_terrain",
    "load_scene",
    "rough_terrain",
]
