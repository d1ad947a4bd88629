"""An MP4 video of one or more runs, or a clear reason why this machine cannot render one.

Rendering runs in a child process: MuJoCo chooses its OpenGL library at import, and a driver that crashes must not take
the caller with it. Marks are drawn as MuJoCo's geoms, made from the same parts as the replay's.
"""

import dataclasses
import json
import os
import pathlib
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import imageio.v2 as imageio
import meshcat.geometry as geometry
import mujoco
import numpy as np
from PIL import Image, ImageColor, ImageDraw, ImageFont

from hugwbc import rotations
from hugwbc.errors import UnknownNameError
from hugwbc.files import write_whole
from hugwbc.robot import load_robot
from hugwbc.runtime.trace import Trace, read_trace, write_trace
from hugwbc.sim.robot_model import SIMULATION_TIMESTEP, load_model
from hugwbc.viz.framing import LABEL_COLOURS, Chapter, camera_path, check_traces, frame_samples, lanes, snapshot
from hugwbc.viz.marks import FORCE, FORCE_RADIUS, LAYERS, Mark, Marks, footprint, mark_shapes
from hugwbc.viz.meshcat_scene import LOOK_AT_HEIGHT, labelled_colour
from hugwbc.viz.shapes import CYLINDER_TO_Z, Shape, hex_colour, shapes_of

FPS = 25
WIDTH, HEIGHT = 1280, 720  # [pixel], multiples of 16 as the encoder requires
SAMPLES = 4  # of a pixel, against jagged edges
HINT = "on Linux without a display install Mesa's EGL (Debian: libegl1 libgl1)"
# A geom is a row of numbers: type, size (3), position (3), rotation matrix (9), red, green, blue and opacity.
GEOM_NUMBERS = 20
ARROW_RADIUS = 2.0 * FORCE_RADIUS  # [m], of the head; the shaft of MuJoCo's arrows is thinner
PRINT_OPACITY = 0.8
TEXT_SIZE = 26  # [pixel]
NAME_HEIGHT = 0.85  # [m] of a robot's name above its pelvis
VIEW = (200.0, -10.0)  # [deg], azimuth and elevation: from ahead
SCENE_VIEW = (290.0, -14.0)  # [deg], from the left and a little from behind: what a robot works at is ahead of it
_SCENE = "around/"
_SHARED = ("timestep", "iterations", "ls_iterations", "integrator", "jacobian")  # what attached models must agree in


def write_video(
    path: str | pathlib.Path,
    traces: Sequence[Trace],
    *,
    hide: Sequence[str] = (),
    chapters: Sequence[Chapter] = (),
    on_progress: Callable[[float], None] | None = None,
) -> str | None:
    """Render one to four runs side by side, in the colours of `LABEL_COLOURS`, with the marks around them.

    Names, clock and chapter are written into the picture; layers of `marks.LAYERS` may be hidden. Return None if the
    file was written, and otherwise one line that says why not.
    """
    check_traces(traces)
    for name in hide:
        if name not in LAYERS:
            raise UnknownNameError("layer", name, LAYERS)
    with tempfile.TemporaryDirectory() as folder:
        log, film = pathlib.Path(folder) / "log.txt", pathlib.Path(folder) / "film.mp4"
        for number, trace in enumerate(traces):
            write_trace(pathlib.Path(folder) / f"run_{number}.npz", trace)
        settings = {"hide": list(hide), "chapters": [dataclasses.asdict(chapter) for chapter in chapters]}
        command = [sys.executable, "-m", "hugwbc.viz.video", json.dumps(settings), str(film)]
        # The log goes to a file: a driver that prints a lot would block on a pipe that nobody reads.
        options: Any = {"stdout": subprocess.PIPE, "text": True, "env": renderer_environment(), "cwd": folder}
        with log.open("w", encoding="utf-8") as errors, subprocess.Popen(command, stderr=errors, **options) as process:
            for line in process.stdout or ():
                if on_progress is not None and line.strip().isdigit():
                    on_progress(int(line) / frame_count(traces))
        if process.returncode == 0:
            try:
                write_whole(path, film.read_bytes())
            except OSError as error:
                return f"no video: cannot write {path}: {error.strerror}"
            return None
        lines = log.read_text(encoding="utf-8", errors="replace").strip().splitlines()
    return f"no video: {lines[-1] if lines else f'the renderer ended with code {process.returncode}'}; {HINT}"


def frame_count(traces: Sequence[Trace]) -> int:
    """Return how many frames a film of the runs has."""
    return len(frame_samples(traces[0].time, FPS, max(float(trace.time[-1]) for trace in traces)))


def captions(traces: Sequence[Trace], chapters: Sequence[Chapter]) -> list[dict[str, Any]]:
    """Return what is written into each frame: "names" (text and colour of each robot), "clock" and "chapter"."""
    begin = float(traces[0].time[0])
    frames = []
    for number in range(frame_count(traces)):
        now = begin + number / FPS
        names = [
            (f"{trace.name} (fell)" if trace.fell and now >= trace.time[-1] else trace.name, colour)
            for trace, colour in zip(traces, LABEL_COLOURS, strict=False)
        ]
        chapter = next((chapter.name for chapter in reversed(chapters) if chapter.begin <= now + 1e-9), "")
        frames.append({"names": names, "clock": f"{now:.1f} s", "chapter": chapter})
    return frames


def write_captions(picture: np.ndarray, caption: Mapping[str, Any]) -> np.ndarray:
    """Return the picture with a caption of `captions`; shape (height, width, 3), uint8."""
    image = Image.fromarray(picture)
    draw = ImageDraw.Draw(image)
    font, (ink, halo) = ImageFont.load_default(TEXT_SIZE), ("#1c2430", "#ffffff")
    edge, step = TEXT_SIZE, round(1.5 * TEXT_SIZE)
    for number, (name, colour) in enumerate(caption["names"]):
        top = edge + number * step
        draw.rectangle((edge, top + 4, edge + TEXT_SIZE - 4, top + TEXT_SIZE), fill=colour, outline=halo)
        draw.text((edge + step, top), name, fill=ink, font=font, stroke_width=2, stroke_fill=halo)
    corner = picture.shape[1] - edge
    draw.text((corner, edge), caption["clock"], fill=ink, font=font, anchor="ra", stroke_width=2, stroke_fill=halo)
    place = (picture.shape[1] // 2, picture.shape[0] - edge)
    draw.text(place, caption["chapter"], fill=ink, font=font, anchor="ms", stroke_width=2, stroke_fill=halo)
    return np.asarray(image)


def renderer_environment() -> dict[str, str]:
    """Return the renderer's environment: EGL on Linux without a display, unless the user has chosen another library."""
    environment = dict(os.environ)
    if sys.platform.startswith("linux") and "DISPLAY" not in environment:
        environment.setdefault("MUJOCO_GL", "egl")
    return environment


def mark_geoms(trace: Trace, samples: np.ndarray, label: str, offset: float, layers: Sequence[str]) -> list[np.ndarray]:
    """Return the geoms of a run's marks at some samples: for each frame an array of shape (geoms, `GEOM_NUMBERS`).

    The label is the robot's colour as "#rrggbb", the offset that to the left [m], and the layers are names in
    `marks.LAYERS`.
    """
    robot = load_robot(trace.robot)
    model = load_model(SIMULATION_TIMESTEP, robot=robot)
    marks = Marks(model, robot)
    parts = {
        name: pieces
        for name, pieces in mark_shapes(shapes_of(model), label, robot).items()
        if name.split("/")[0] in layers
    }
    part = footprint(robot, label, PRINT_OPACITY)
    prints = [(time, _geom(part, mark.placement)) for time, mark in marks.footprints(trace) if "steps" in layers]
    frames = []
    for sample in samples:
        placed = marks.at(snapshot(trace, int(sample)))
        rows = [row for time, row in prints if time <= trace.time[sample]]
        for name, pieces in parts.items():
            placement = _placement(name, placed)
            if placement is not None:
                rows += [_arrow(placement)] if name.startswith("forces/") else [_geom(p, placement) for p in pieces]
        frame = np.array(rows).reshape(-1, GEOM_NUMBERS)
        frame[:, 5] += offset
        frames.append(frame)
    return frames


def _placement(name: str, placed: Mapping[str, Mark]) -> np.ndarray | None:
    """Return a mark's placement in the world, shape (4, 4); None if it, or a mark above it in its path, is hidden."""
    placement, steps = np.eye(4), name.split("/")
    for end in range(1, len(steps) + 1):
        mark = placed.get("/".join(steps[:end]))
        if mark is None:
            continue
        if not mark.visible:
            return None
        placement = placement @ mark.placement
    return placement


def _geom(part: Shape, placement: np.ndarray) -> np.ndarray:
    """Return one primitive as a row; the placement must scale along its axes, because geoms cannot be sheared."""
    whole = placement @ part.placement
    scale = np.linalg.norm(whole[:3, :3], axis=0)
    turn, primitive = whole[:3, :3] / scale, part.primitive
    match primitive:
        case geometry.Ellipsoid():
            kind, size = mujoco.mjtGeom.mjGEOM_ELLIPSOID, np.asarray(primitive.radii) * scale
        case geometry.Sphere():
            kind, size = mujoco.mjtGeom.mjGEOM_SPHERE, primitive.radius * scale
        case geometry.Box():
            kind, size = mujoco.mjtGeom.mjGEOM_BOX, 0.5 * np.asarray(primitive.lengths) * scale
        case geometry.Cylinder():  # along y in meshcat, along z in MuJoCo
            radius, half = primitive.radiusBottom * scale[0], 0.5 * primitive.height * scale[1]
            kind, size = mujoco.mjtGeom.mjGEOM_CYLINDER, np.array([radius, half, 0.0])
            turn = turn @ CYLINDER_TO_Z[:3, :3].T
        case _:
            raise TypeError(f"MuJoCo has no geom for a {type(primitive).__name__}")
    return _row(kind, size, whole[:3, 3], turn, part.colour, part.opacity)


def _arrow(placement: np.ndarray) -> np.ndarray:
    """Return a force's arrow along z as one of MuJoCo's arrows, because MuJoCo has no cones for an arrow's head."""
    scale = np.linalg.norm(placement[:3, :3], axis=0)
    size = np.array([ARROW_RADIUS, ARROW_RADIUS, scale[2]])
    return _row(mujoco.mjtGeom.mjGEOM_ARROW, size, placement[:3, 3], placement[:3, :3] / scale, FORCE, 0.9)


def _row(
    kind: mujoco.mjtGeom, size: np.ndarray, position: np.ndarray, turn: np.ndarray, colour: str, opacity: float
) -> np.ndarray:
    rgba = [*(value / 255 for value in ImageColor.getrgb(colour)), opacity]
    return np.concatenate(([int(kind)], size, position, turn.ravel(), rgba))


def _object_poses(traces: Sequence[Trace], samples: Sequence[np.ndarray]) -> tuple[list[str], np.ndarray]:
    """Return the names of all bodies around the robots, as `_stage` has them, and their poses in the lanes.

    The poses are positions [m] and quaternions (w, x, y, z), shape (frames, bodies, 7).
    """
    names, poses = [], [np.zeros((len(samples[0]), 0, 7))]
    for index, (trace, sample, lane) in enumerate(zip(traces, samples, lanes(len(traces)), strict=True)):
        if trace.scene is not None:
            names += [f"{index}_{_SCENE}{name}" for name in trace.scene.body_names]
            poses.append(trace.object_pose[sample] + [0.0, lane, 0.0, 0.0, 0.0, 0.0, 0.0])
    return names, np.concatenate(poses, axis=1)


def _stage(traces: Sequence[Trace]) -> mujoco.MjModel:
    """Return a model with floor, light, sky, and the robots in their label colours among their objects.

    It is for rendering only.
    """
    stage = mujoco.MjSpec()
    stage.visual.global_.offwidth, stage.visual.global_.offheight = WIDTH, HEIGHT
    stage.visual.headlight.ambient, stage.visual.headlight.diffuse = [0.4] * 3, [0.4] * 3
    # Without a graphics card every vertex costs time: no finer shapes than one sees, no shadows.
    stage.visual.quality.numslices, stage.visual.quality.numstacks = 24, 12
    stage.visual.quality.offsamples = SAMPLES
    sky = {"type": mujoco.mjtTexture.mjTEXTURE_SKYBOX, "builtin": mujoco.mjtBuiltin.mjBUILTIN_GRADIENT}
    stage.add_texture(name="sky", **sky, rgb1=[0.75, 0.81, 0.88], rgb2=[0.95, 0.96, 0.98], width=256, height=256)
    tiles = {"type": mujoco.mjtTexture.mjTEXTURE_2D, "builtin": mujoco.mjtBuiltin.mjBUILTIN_CHECKER}
    stage.add_texture(name="tiles", **tiles, rgb1=[0.72] * 3, rgb2=[0.66] * 3, width=256, height=256)
    material = stage.add_material(name="tiles", texrepeat=[1, 1], texuniform=True)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "tiles"
    stage.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 0.05], material="tiles")
    stage.worldbody.add_light(pos=[0, 0, 6], dir=[-0.3, 0.4, -1], type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL)
    for index in range(len(traces)):
        robot = mujoco.MjSpec.from_file(str(load_robot(traces[index].robot).xml_path))
        for element in (robot.geom("floor"), *robot.lights, *robot.keys, *robot.sensors, *robot.actuators):
            robot.delete(element)
        for finish in robot.materials:
            colour = labelled_colour(finish.name, hex_colour(finish.rgba[:3]), LABEL_COLOURS[index])
            finish.rgba = [*(value / 255 for value in ImageColor.getrgb(colour)), 1.0]
        for field in _SHARED:
            setattr(stage.option, field, getattr(robot.option, field))  # attached models must agree with the stage
        stage.attach(robot, prefix=f"{index}_", frame=stage.worldbody.add_frame())
    # After all robots, so that these come first in the state.
    for index, (trace, lane) in enumerate(zip(traces, lanes(len(traces)), strict=True)):
        if trace.scene is not None:
            around = mujoco.MjSpec()
            around.compiler.degree = False
            trace.scene.add_to(around)
            for field in _SHARED:
                setattr(around.option, field, getattr(stage.option, field))
            stage.attach(around, prefix=f"{index}_{_SCENE}", frame=stage.worldbody.add_frame(pos=[0.0, lane, 0.0]))
    return stage.compile()


def _place(model: mujoco.MjModel, data: mujoco.MjData, bodies: np.ndarray, poses: np.ndarray) -> None:
    """Put the shapes of bodies where these are, whatever the model's joints say; poses of shape (bodies, 7)."""
    for body, pose in zip(bodies, poses, strict=True):
        turn = rotations.to_matrix(pose[3:])
        first = int(model.body_geomadr[body])
        for geom in range(first, first + int(model.body_geomnum[body])):
            data.geom_xpos[geom] = pose[:3] + turn @ model.geom_pos[geom]
            data.geom_xmat[geom] = (turn @ rotations.to_matrix(model.geom_quat[geom])).ravel()


def _add_geoms(scene: mujoco.MjvScene, rows: np.ndarray) -> None:
    """Add geoms to a scene, rows as `mark_geoms` returns them, up to the scene's capacity."""
    for row in rows[: scene.maxgeom - scene.ngeom]:
        size, position, turn, rgba = row[1:4], row[4:7], row[7:16], row[16:].astype(np.float32)
        mujoco.mjv_initGeom(scene.geoms[scene.ngeom], int(row[0]), size, position, turn, rgba)
        scene.ngeom += 1


def _add_name(scene: mujoco.MjvScene, name: str, position: np.ndarray) -> None:
    """Write a robot's name at a position in the world [m], if the scene has room for a geom."""
    if scene.ngeom < scene.maxgeom:
        geom, nothing = scene.geoms[scene.ngeom], np.zeros(4, dtype=np.float32)
        mujoco.mjv_initGeom(geom, mujoco.mjtGeom.mjGEOM_LABEL, np.zeros(3), position, np.eye(3).ravel(), nothing)
        geom.label = name
        scene.ngeom += 1


def _render(traces: Sequence[Trace], layers: Sequence[str], chapters: Sequence[Chapter], path: pathlib.Path) -> None:
    """Render a film of runs, and write the number of each finished frame to standard output."""
    end = max(float(trace.time[-1]) for trace in traces)
    samples = [frame_samples(trace.time, FPS, end) for trace in traces]
    offsets = lanes(len(traces))
    frames = np.stack([trace.qpos[sample] for trace, sample in zip(traces, samples, strict=True)], axis=1)
    frames[:, :, 1] += offsets
    marks = [
        mark_geoms(*of_run, layers) for of_run in zip(traces, samples, LABEL_COLOURS, offsets.tolist(), strict=False)
    ]
    names, poses = _object_poses(traces, samples)
    model = _stage(traces)
    bodies = np.array([model.body(name).id for name in names], dtype=int)
    data = mujoco.MjData(model)
    options = mujoco.MjvOption()
    options.geomgroup[3] = 0
    camera = mujoco.MjvCamera()
    camera.azimuth, camera.elevation = SCENE_VIEW if names else VIEW
    looked_at, distance = camera_path(traces, FPS, end)
    texts = captions(traces, chapters)
    with (
        mujoco.Renderer(model, HEIGHT, WIDTH) as renderer,
        imageio.get_writer(path, fps=FPS, codec="libx264", quality=7) as writer,
    ):
        for number, frame in enumerate(frames):
            data.qpos[: frame.size] = frame.ravel()
            mujoco.mj_kinematics(model, data)
            _place(model, data, bodies, poses[number])
            mujoco.mj_camlight(model, data)
            camera.lookat[:] = [*looked_at[number], LOOK_AT_HEIGHT]
            camera.distance = distance[number] * (2.2 + 0.7 * len(traces))
            renderer.update_scene(data, camera, options)
            for trace, pose, of_run in zip(traces, frame, marks, strict=True):
                _add_geoms(renderer.scene, of_run[number])
                _add_name(renderer.scene, trace.name, np.array([*pose[:2], pose[2] + NAME_HEIGHT]))
            for flag in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION):
                renderer.scene.flags[flag] = 0
            writer.append_data(write_captions(renderer.render(), texts[number]))
            sys.stdout.write(f"{number + 1}\n")
            sys.stdout.flush()


if __name__ == "__main__":
    settings, film = json.loads(sys.argv[1]), pathlib.Path(sys.argv[2])
    _render(
        [read_trace(file) for file in sorted(film.parent.glob("run_*.npz"))],
        [layer for layer in LAYERS if layer not in settings["hide"]],
        [Chapter(**chapter) for chapter in settings["chapters"]],
        film,
    )
