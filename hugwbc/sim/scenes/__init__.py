"""Scenes: objects around the robot, declared in YAML or as frozen dataclasses."""

from hugwbc.hand_wrench import BREAKING_FORCE
from hugwbc.sim.scenes.furniture import Shelf, Step, Table, Wall
from hugwbc.sim.scenes.gripper import REACH, Gripper
from hugwbc.sim.scenes.jointed import Button, Door, Drawer
from hugwbc.sim.scenes.mjcf_file import Mjcf
from hugwbc.sim.scenes.movable import Box, Cart, Cylinder, Tray
from hugwbc.sim.scenes.objects import Objects, ObjectState, SceneObjects
from hugwbc.sim.scenes.scene import SCENE_NAMES, Scene, load_scene
from hugwbc.sim.scenes.thing import Thing
from hugwbc.sim.scenes.varied import Choice, Uniform

__all__ = [
    "BREAKING_FORCE",
    "REACH",
    "SCENE_NAMES",
    "Box",
    "Button",
    "Cart",
    "Choice",
    "Cylinder",
    "Door",
    "Drawer",
    "Gripper",
    "Mjcf",
    "ObjectState",
    "Objects",
    "Scene",
    "SceneObjects",
    "Shelf",
    "Step",
    "Table",
    "Thing",
    "Tray",
    "Uniform",
    "Wall",
    "load_scene",
]
