"""A meshcat scene with robots and the marks around them, live in a browser or recorded into a page."""

import io
from collections.abc import Sequence

import meshcat
import meshcat.geometry as geometry
import mujoco
import numpy as np
from PIL import Image, ImageColor

from hugwbc.robot import Robot
from hugwbc.runtime.trace import Snapshot
from hugwbc.sim import scenes
from hugwbc.sim.robot_model import SIMULATION_TIMESTEP, load_model
from hugwbc.viz.framing import LABEL_COLOURS, lanes
from hugwbc.viz.marks import UPRIGHT, Mark, Marks, footprint, mark_shapes
from hugwbc.viz.shapes import Shape, hex_colour, homogeneous, shapes_of

CAMERA_POSITION = (2.3, 0.45, 0.8)  # [m] from the point looked at, in meshcat's camera axes (x, up, -y)
# From the left and a little from behind: what a robot works at is ahead of it.
SCENE_CAMERA_POSITION = (-0.9, 0.8, -2.6)
LOOK_AT_HEIGHT = 0.85  # [m]
LIVE_FOOTPRINTS = 40  # number of footprints that a live picture keeps
# meshcat's camera always circles the origin, so the scene moves the world instead of the camera.
WORLD = "world"
FLOOR_SIZE, TILE = 60.0, 0.5  # [m]
_LABELLED_MATERIALS = {"light": 0.3, "lamp": 1.0}  # share of the label colour in each material


def labelled_colour(material: str, colour: str, label: str) -> str:
    """Return a colour ("#rrggbb") with the label mixed into shells and lamp, so that robots can be told apart."""
    share = _LABELLED_MATERIALS.get(material, 0.0)
    return hex_colour(
        ((1 - share) * np.array(ImageColor.getrgb(colour)) + share * np.array(ImageColor.getrgb(label))) / 255
    )


class RobotView:
    """One robot of a scene, with the objects and the marks around it.

    Attributes:
        path: path of the robot in the world; `at` names what is below it.
        marks: where the robot's links and the marks around it are, by snapshot.
    """

    def __init__(
        self,
        node: meshcat.Visualizer,
        path: str,
        model: mujoco.MjModel,
        label: str,
        offset: float,
        robot: Robot,
        scene: scenes.Scene | None,
    ) -> None:
        """Put the shapes of the robot, of its marks, and of the objects around it into the world.

        The path is that of the robot in the world, the model has visual shapes, the label is the robot's colour as
        "#rrggbb", and the offset to the left sets robots side by side [m].
        """
        self.path, self.marks = path, Marks(model, robot)
        self._node, self._robot, self._label = node[path], robot, label
        self._node.set_transform(homogeneous(np.array([0.0, offset, 0.0]), UPRIGHT))
        shapes = shapes_of(model)
        for index, shape in enumerate(shapes):
            colour = labelled_colour(shape.material, shape.colour, label)
            material = geometry.MeshPhongMaterial(color=int(colour[1:], 16), shininess=40)
            self._add(f"links/{shape.body}/{index}", shape, material)
        self._links = {f"links/{shape.body}": shape.body for shape in shapes}
        for name, parts in mark_shapes(shapes, label, robot).items():
            for index, part in enumerate(parts):
                self._add(f"{name}/{index}", part)
        self._steps, self._on_ground = 0, np.zeros(2, dtype=bool)
        self._visible: dict[str, bool] = {}
        self._objects = () if scene is None else tuple(f"objects/{number}" for number in range(len(scene.body_names)))
        if scene is not None:
            self._add_objects(scene)

    def _add(self, path: str, shape: Shape, material: geometry.Material | None = None) -> None:
        # The browser draws transparent parts last; without a depth test they then cover everything.
        last = {"transparent": True, "depthTest": False} if shape.on_top else {}
        own = geometry.MeshPhongMaterial(color=int(shape.colour[1:], 16), opacity=shape.opacity, **last)
        self._node[path].set_object(shape.primitive, material or own)
        self._node[path].set_transform(shape.placement)

    def _add_objects(self, scene: scenes.Scene) -> None:
        model = scene.model()
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        paths = dict(zip(scene.body_names, self._objects, strict=True))
        for index, shape in enumerate(shapes_of(model)):
            # What an MJCF file has in its world moves as little as the world.
            self._add(f"{paths.get(shape.body, 'objects/still')}/{index}", shape)
        for name, path in paths.items():
            self.place(path, Mark(True, data.body(name).xpos, data.body(name).xquat))

    def at(self, snapshot: Snapshot) -> dict[str, Mark]:
        """Return where all links, objects and marks are, by their paths below the robot."""
        marks = self.marks.at(snapshot)  # which moves the links
        poses = zip(self._objects, snapshot.object_pose, strict=False)
        objects = {path: Mark(True, pose[:3], pose[3:]) for path, pose in poses}
        return {path: self.marks.body(link) for path, link in self._links.items()} | objects | marks

    def add_footprint(self, number: int, mark: Mark) -> str:
        """Put footprint `number` on the ground, in place of an earlier one; return its path below the robot."""
        path = f"steps/placed_{number}"
        self._add(f"{path}/0", footprint(self._robot, self._label, 0.8))
        self.place(path, mark)
        return path

    def place(self, path: str, mark: Mark) -> None:
        """Put what has this path below the robot in its place, or hide it."""
        node = self._node[path]
        if self._visible.get(path, True) != mark.visible:
            node.set_property("visible", mark.visible)
            self._visible[path] = mark.visible
        if mark.visible:
            node.set_transform(mark.placement)

    def show(self, snapshot: Snapshot) -> None:
        """Show the robot and its marks live; a foot that comes down leaves a footprint."""
        for path, mark in self.at(snapshot).items():
            self.place(path, mark)
        for foot in np.flatnonzero(snapshot.foot_contact & ~self._on_ground):
            self.add_footprint(self._steps % LIVE_FOOTPRINTS, self.marks.footprint(snapshot.qpos, int(foot)))
            self._steps += 1
        self._on_ground = snapshot.foot_contact


def _tiles() -> geometry.Material:
    """Return the material of a checkered floor: an image of two by two tiles, repeated."""
    light, dark = 236, 222
    pixels = np.kron(np.array([[light, dark], [dark, light]], dtype=np.uint8), np.ones((32, 32), dtype=np.uint8))
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, format="png")
    repeat = FLOOR_SIZE / (2 * TILE)
    repeat_wrapping = 1000  # three.js' constant
    texture = geometry.ImageTexture(geometry.PngImage(file.getvalue()), wrap=[repeat_wrapping] * 2, repeat=[repeat] * 2)
    return geometry.MeshLambertMaterial(map=texture)


class Scene:
    """Robots side by side on a tiled floor, seen from ahead and to the side."""

    def __init__(
        self,
        visualizer: meshcat.Visualizer,
        names: Sequence[str],
        robot: Robot,
        around: Sequence[scenes.Scene | None] = (),
    ) -> None:
        """Build the scene of robots by their names, the first leftmost, each with the objects around it."""
        self.visualizer = visualizer
        visualizer.delete()
        visualizer["/Background"].set_property("top_color", [0.93, 0.95, 0.98])
        visualizer["/Background"].set_property("bottom_color", [0.72, 0.77, 0.84])
        for name in ("/Grid", "/Axes"):
            visualizer[name].set_property("visible", False)
        visualizer["/Lights/AmbientLight/<object>"].set_property("intensity", 0.75)
        floor = visualizer[WORLD]["floor"]
        floor.set_object(geometry.Box([FLOOR_SIZE, FLOOR_SIZE, 0.02]), _tiles())
        floor.set_transform(homogeneous(np.array([0.0, 0.0, -0.01]), UPRIGHT))
        camera = SCENE_CAMERA_POSITION if any(around) else CAMERA_POSITION
        visualizer["/Cameras/default/rotated/<object>"].set_property("position", list(camera))
        model = load_model(SIMULATION_TIMESTEP, robot=robot)
        self.robots = [
            RobotView(
                visualizer[WORLD], f"robot_{i}", model, LABEL_COLOURS[i % len(LABEL_COLOURS)], offset, robot, scene
            )
            for i, (offset, scene) in enumerate(zip(lanes(len(names)), around or [None] * len(names), strict=True))
        ]
        self.look_at(np.zeros(2))

    def look_at(self, xy: np.ndarray) -> None:
        """Bring the point `xy` on the ground [m], shape (2,), into the middle of the picture."""
        self.visualizer[WORLD].set_transform(homogeneous(world_offset(xy), UPRIGHT))


def world_offset(xy: np.ndarray) -> np.ndarray:
    """Return where to move the world so that the camera looks at points on the ground [m], shape (..., 2)."""
    xy = np.asarray(xy, dtype=float)
    return -np.concatenate((xy, np.full((*xy.shape[:-1], 1), LOOK_AT_HEIGHT)), axis=-1)
