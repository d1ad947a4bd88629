"""Films of what cameras see in an episode, rendered afterwards from the recorded positions.

`head` is the robot's own camera, `front` one that stands before the robot and looks back at it. MuJoCo renders in a
process of its own, because the library that it renders with is chosen when it is imported.
"""

import json
import math
import pathlib
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from typing import Any

import imageio.v2 as imageio
import mujoco
import numpy as np

from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.robot import Robot, load_robot
from hugwbc.viz.video import HINT, renderer_environment

SIZE = 224  # pixels in height and width
CAMERAS = ("head", "front")
_BEFORE, _DOWN = np.array([0.0315, 0.0, 0.0]), math.radians(40.0)  # of the head camera: out of the shell [m]; pitch
_FIELDS = {"head": math.radians(69.0), "front": math.radians(50.0)}  # of view, both ways; 69 is a D435's horizontal one
_AHEAD, _HEIGHT = 2.8, 2.5  # of the front camera: ahead of the pelvis in the first heading, and above the ground [m]
_LIGHT = 0.3  # ambient light: sides in the shade stay visible
_EVERY = 10  # one of so many frames counts in the statistics


def check_cameras(names: Sequence[str]) -> None:
    """Refuse names that are not of `CAMERAS`, and the same name twice."""
    for name in names:
        if name not in CAMERAS:
            raise UnknownNameError("camera", name, CAMERAS)
    if len(set(names)) < len(names):
        raise ConfigError(f"cameras are {', '.join(names)}; give each once")


def render_films(
    model: mujoco.MjModel, robot: Robot, qpos: np.ndarray, cameras: Sequence[str], fps: int, folder: pathlib.Path
) -> dict[str, dict[str, Any]]:
    """Write a film of each camera, a name in `CAMERAS`, as NAME.mp4 into an existing folder; return its statistics.

    These are "min", "max", "mean" and "std" of the three channels, from 0 to 1, and "count", the number of frames that
    they are of. The model holds the robot and what is around it; qpos are the positions of all joints in each frame,
    shape (T, model.nq). A machine that cannot render raises a `ConfigError`.
    """
    check_cameras(cameras)
    with tempfile.TemporaryDirectory() as place:
        compiled, positions = pathlib.Path(place) / "model.mjb", pathlib.Path(place) / "qpos.npy"
        mujoco.mj_saveModel(model, str(compiled))
        np.save(positions, qpos, allow_pickle=False)
        words = [str(compiled), str(positions), str(folder.absolute()), str(fps), robot.name, *cameras]
        command = [sys.executable, "-m", "hugwbc.viz.cameras", *words]
        done = subprocess.run(command, capture_output=True, text=True, env=renderer_environment(), cwd=place)
    if done.returncode:
        lines = done.stderr.strip().splitlines()
        raise ConfigError(f"no camera images: {lines[-1] if lines else 'the renderer ended'}; {HINT}")
    return json.loads(done.stdout.splitlines()[-1])


def view_of(
    name: str, model: mujoco.MjModel, robot: Robot, data: mujoco.MjData, heading: np.ndarray
) -> list[np.ndarray]:
    """Return place, forward and upward direction of a camera in the world, shape (3,) each.

    The heading is the horizontal direction of the robot at the first frame, shape (3,).
    """
    if name == "head":
        torso = model.body(robot.trunk).id
        turn = data.xmat[torso].reshape(3, 3)
        cosine, sine = math.cos(_DOWN), math.sin(_DOWN)
        ahead, above = np.array([cosine, 0.0, -sine]), np.array([sine, 0.0, cosine])
        return [data.xpos[torso] + turn @ (robot.camera + _BEFORE), turn @ ahead, turn @ above]
    pelvis = data.xpos[model.body(robot.base).id]
    place = np.array([*(pelvis + _AHEAD * heading)[:2], _HEIGHT])
    forward = (pelvis - place) / np.linalg.norm(pelvis - place)
    upward = np.array([0.0, 0.0, 1.0]) - forward[2] * forward
    return [place, forward, upward / np.linalg.norm(upward)]


def _render(
    model: mujoco.MjModel, robot: Robot, qpos: np.ndarray, cameras: Sequence[str], fps: int, folder: pathlib.Path
) -> None:
    """Render all films, and write their statistics to standard output."""
    data, options, heading = mujoco.MjData(model), mujoco.MjvOption(), np.zeros(3)
    options.geomgroup[3] = 0
    model.vis.headlight.ambient[:] = _LIGHT
    seen: dict[str, list[np.ndarray]] = {name: [] for name in cameras}
    films = {name: imageio.get_writer(folder / f"{name}.mp4", fps=fps, codec="libx264", quality=8) for name in cameras}
    with mujoco.Renderer(model, SIZE, SIZE) as renderer:
        for number, positions in enumerate(qpos):
            data.qpos[:] = positions
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_camlight(model, data)
            if not number:
                x, y, _ = data.xmat[model.body(robot.base).id].reshape(3, 3)[:, 0]
                heading[:] = np.array([x, y, 0.0]) / math.hypot(x, y)
            for name in cameras:
                renderer.update_scene(data, mujoco.MjvCamera(), options)
                place, forward, upward = view_of(name, model, robot, data, heading)
                for eye in renderer.scene.camera:
                    eye.pos, eye.forward, eye.up = place, forward, upward
                    edge = eye.frustum_near * math.tan(0.5 * _FIELDS[name])
                    eye.frustum_bottom, eye.frustum_top, eye.frustum_center, eye.frustum_width = -edge, edge, 0.0, edge
                picture = renderer.render()
                films[name].append_data(picture)
                if number % _EVERY == 0:
                    seen[name].append(picture.reshape(-1, 3) / 255.0)
    for film in films.values():
        film.close()
    sys.stdout.write(json.dumps({name: _statistics(pictures) for name, pictures in seen.items()}) + "\n")


def _statistics(pictures: Sequence[np.ndarray]) -> dict[str, Any]:
    values = np.concatenate(pictures)
    found = {"min": values.min(0), "max": values.max(0), "mean": values.mean(0), "std": values.std(0)}
    return {name: value.tolist() for name, value in found.items()} | {"count": len(pictures)}


if __name__ == "__main__":
    path, positions, out, rate, of, *names = sys.argv[1:]
    recorded = np.load(positions, allow_pickle=False)
    _render(mujoco.MjModel.from_binary_path(path), load_robot(of), recorded, names, int(rate), pathlib.Path(out))
