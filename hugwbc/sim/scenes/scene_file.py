"""Scenes as YAML files.

    about: A box on a table, and a door to push open.
    robot: h1                     # optional, like ground: the arena's
    ground: firm
    objects:
      - {kind: table, name: desk, position: [0.9, 0], height: {uniform: [0.7, 0.95]}}
      - kind: box
        name: parcel
        on: desk                  # position and yaw are then relative to the middle of its top
        position: [-0.1, 0]
        size: [0.3, 0.25, 0.2]
        mass: {uniform: [0.5, 3]}
        colour: {choice: ["#c8a165", "#7fa3c7"]}
      - {kind: door, name: exit, hinge: left, position: [3, 0], closer: {uniform: [5, 15]}}
      - {name: kitchen, mjcf: my_kitchen.xml, position: [2, 3], yaw: 1.57}

The kinds are the classes of `sim.scenes`, with their fields. Every number may be `{uniform: [low, high]}` or
`{choice: [a, b]}`, every colour a choice. Paths of MJCF files are relative to the scene. YAML anchors may repeat parts.
"""

import pathlib

from hugwbc.settings_file import load, named_path, shipped_names
from hugwbc.sim.scenes.scene import Scene

FOLDER = pathlib.Path(__file__).parent
SCENE_NAMES = shipped_names(FOLDER)


def load_scene(name: str | pathlib.Path) -> Scene:
    """Load a shipped scene, one of `SCENE_NAMES`, or a scene from a path that ends in .yaml or .yml."""
    return load(Scene, named_path("scene", name, FOLDER))
