"""A meshcat scene with robots and the marks around them, live in a browser or recorded into a page."""

import io
from collections.abc import Sequence

import meshcat
import meshcat.geometry as geometry
import mujoco
import numpy as np
from PIL import Image

from hugwbc.robot import Robot, load_robot
from hugwbc.runtime.moment import Moment
from hugwbc.sim import scenes
from hugwbc.sim.layout import robot_layout
from hugwbc.sim.robot_model import SIMULATION_TIMESTEP, load_model
from hugwbc.viz.framing import LABEL_COLOURS, lanes
from hugwbc.viz.marks import LAYERS, UPRIGHT, Mark, Marks, Part, footprint, mark_parts
from hugwbc.viz.shapes import Shape, homogeneous, object_shapes, visual_shapes

CAMERA_POSITION = (2.3, 0.45, 0.8)  # [m] from the point looked at, in meshcat's camera axes (x, up, -y)
# From the left and a little from behind: what a robot works at is ahead of it.
SCENE_CAMERA_POSITION = (-0.9, 0.8, -2.6)
LOOK_AT_HEIGHT = 0.85  # [m]
LIVE_FOOTPRINTS = 40  # number of footprints that a live picture keeps
# meshcat's camera always circles the origin, so the scene moves the world instead of the camera.
WORLD = "world"
FLOOR_SIZE, TILE = 60.0, 0.5  # [m]
_LABELLED_MATERIALS = {"light": 0.3, "lamp": 1.0}  # share of the label colour in each material


def _rgb(colour: str) -> np.ndarray:
    return np.array([int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)])


def _hex(rgb: np.ndarray) -> int:
    red, green, blue = np.round(255 * np.clip(rgb, 0, 1)).astype(int).tolist()
    return red << 16 | green << 8 | blue


def labelled_colour(material: str, rgb: Sequence[float], label: str) -> np.ndarray:
    """Return a material's colour, with the label colour mixed into shells and lamp so that robots can be told apart.

    Args:
        material: name of the material.
        rgb: its own colour, each component in [0, 1].
        label: the robot's label colour as "#rrggbb".
    """
    share = _LABELLED_MATERIALS.get(material, 0.0)
    return (1 - share) * np.asarray(rgb) + share * _rgb(label)


class RobotView:
    """One robot of a scene, with the marks around it.

    Attributes:
        marks: the marks around the robot, by moment.
        path: path of the robot in the world; each link is a child with the link's name.
        links: names of the links that are drawn.
        objects: names of the bodies of the scene around the robot.
        offset: offset of every position, which sets robots side by side [m], shape (3,).
    """

    def __init__(
        self,
        node: meshcat.Visualizer,
        path: str,
        model: mujoco.MjModel,
        label: str,
        offset: float,
        robot: Robot | None = None,
        scene: scenes.Scene | None = None,
    ) -> None:
        """Put the shapes of the robot, and of the objects around it, into the world.

        Args:
            node: node of the scene's world.
            path: path of the robot in the world.
            model: MuJoCo model with visual shapes.
            label: colour of the robot as "#rrggbb".
            offset: offset to the left [m].
            robot: robot that the model holds; None for the H1.
            scene: objects around the robot, as drawn; None for none.
        """
        self.path = path
        self.offset = np.array([0.0, offset, 0.0])
        self._model, self._data = model, mujoco.MjData(model)
        self._layout = robot_layout(model, robot or load_robot())
        self._node = node[path]
        shapes = visual_shapes(model)
        self.links = tuple(dict.fromkeys(shape.link for shape in shapes))
        self._bodies = [model.body(link).id for link in self.links]
        for index, shape in enumerate(shapes):
            self._add(shape, index, label)
        self.marks = Marks(model, robot)
        self._label, self._steps, self._on_ground = label, 0, np.zeros(2, dtype=bool)
        self.objects: tuple[str, ...] = () if scene is None else scene.body_names
        if scene is not None:
            self._add_objects(scene.model())
        for layer in LAYERS:
            self._node[layer].set_transform(homogeneous(self.offset, UPRIGHT))
        for name, parts in mark_parts(shapes, label, self.marks.sole).items():
            for index, part in enumerate(parts):
                self._add_part(f"{name}/part_{index}", part)

    def _add_part(self, name: str, part: Part) -> None:
        # The browser draws transparent parts last; without a depth test they then cover everything.
        last = {"transparent": True, "depthTest": False} if part.on_top else {}
        material = geometry.MeshPhongMaterial(color=_hex(_rgb(part.colour)), opacity=part.opacity, **last)
        self._node[name].set_object(part.primitive, material)
        self._node[name].set_transform(part.placement)

    def add_footprint(self, number: int, mark: Mark) -> str:
        """Put footprint `number` on the ground, in place of an earlier one; return its path below the robot."""
        name = f"steps/placed_{number}"
        self._add_part(f"{name}/part_0", footprint(self._label, 0.8))
        self.place(name, mark)
        return name

    def place(self, name: str, mark: Mark) -> None:
        """Put the mark with this path below the robot in its place, or hide it."""
        node = self._node[name]
        node.set_property("visible", mark.visible)
        if mark.visible:
            placement = homogeneous(mark.position, mark.quaternion)
            placement[:3, :3] *= mark.scale
            node.set_transform(placement)

    def _add(self, shape: Shape, index: int, label: str) -> None:
        colour = _hex(labelled_colour(shape.material, shape.colour, label))
        node = self._node[shape.link][str(index)]
        node.set_object(shape.primitive, geometry.MeshPhongMaterial(color=colour, shininess=40))
        node.set_transform(shape.placement)

    def _add_objects(self, model: mujoco.MjModel) -> None:
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        for index, shape in enumerate(object_shapes(model)):
            # What an MJCF file has in its world moves as little as the world.
            path = self.object_path(self.objects.index(shape.link)) if shape.link in self.objects else "objects/still"
            node = self._node[path][str(index)]
            node.set_object(shape.primitive, geometry.MeshPhongMaterial(color=_hex(np.array(shape.colour))))
            node.set_transform(shape.placement)
        self._node["objects/still"].set_transform(homogeneous(self.offset, UPRIGHT))
        bodies = [model.body(name).id for name in self.objects]
        self.place_objects(np.hstack((data.xpos[bodies], data.xquat[bodies])))

    @staticmethod
    def object_path(number: int) -> str:
        """Return the path below the robot of a body of the scene, by its number in `objects`."""
        return f"objects/body_{number}"

    def place_objects(self, poses: np.ndarray) -> None:
        """Show the bodies of the scene at poses: positions [m] and quaternions (w, x, y, z), shape (bodies, 7)."""
        for number, pose in enumerate(poses[: len(self.objects)]):
            self._node[self.object_path(number)].set_transform(homogeneous(pose[:3] + self.offset, pose[3:]))

    def placements(self, qpos: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return where the links are shown: positions [m], shape (links, 3), and quaternions (w, x, y, z), (links, 4).

        Args:
            qpos: pelvis position, quaternion (w, x, y, z) and joint positions, shape (26,).
        """
        self._data.qpos[self._layout.qpos] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        return self._data.xpos[self._bodies] + self.offset, self._data.xquat[self._bodies].copy()

    def set_pose(self, qpos: np.ndarray) -> None:
        """Show the robot at `qpos`: pelvis position, quaternion (w, x, y, z) and joint positions, shape (26,)."""
        for link, position, quaternion in zip(self.links, *self.placements(qpos), strict=True):
            self._node[link].set_transform(homogeneous(position, quaternion))

    def show(self, moment: Moment) -> None:
        """Show the robot and its marks live; a foot that comes down leaves a footprint."""
        self.set_pose(moment.qpos)
        self.place_objects(moment.object_pose)
        for name, mark in self.marks.at(moment).items():
            self.place(name, mark)
        for foot in np.flatnonzero(moment.foot_contact & ~self._on_ground):
            self.add_footprint(self._steps % LIVE_FOOTPRINTS, self.marks.footprint(moment.qpos, int(foot)))
            self._steps += 1
        self._on_ground = moment.foot_contact


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
    """Robots side by side on a tiled floor, seen from ahead and to the side.

    Attributes:
        visualizer: meshcat's root.
        robots: the robots, in the order of the names given.
    """

    def __init__(
        self,
        visualizer: meshcat.Visualizer,
        names: Sequence[str],
        robot: Robot | None = None,
        around: Sequence[scenes.Scene | None] = (),
    ) -> None:
        """Build the scene.

        Args:
            visualizer: where to build it; `hugwbc.viz.server.open_visualizer` gives one with a browser page.
            names: names of the robots, the first one leftmost in the picture.
            robot: robot to draw; None for the H1.
            around: objects around each robot, as drawn; empty for none.
        """
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
    """Return where to move the world so that the camera looks at a point on the ground [m], shape (..., 3).

    Args:
        xy: points on the ground [m], shape (..., 2).
    """
    xy = np.asarray(xy, dtype=float)
    return -np.concatenate((xy, np.full((*xy.shape[:-1], 1), LOOK_AT_HEIGHT)), axis=-1)
