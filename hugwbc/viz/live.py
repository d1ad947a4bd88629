"""The live page: drive a robot by keys, gamepad, touch, sliders, a push, and draggable hand targets. Needs viser."""

import contextlib
import io
import math
import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import mujoco
import numpy as np
import viser
from PIL import ImageColor

from hugwbc import rotations
from hugwbc.commands import COMMAND_NAMES, COMMAND_UNITS, MEASURED_NAMES, VELOCITY_NAMES, Command, command_ranges
from hugwbc.files import finite_json
from hugwbc.gait import Gait
from hugwbc.kinematics import Kinematics
from hugwbc.robot import SIDES
from hugwbc.runtime.command_chain import feasible
from hugwbc.scripts.socket_source import SocketSource
from hugwbc.sim import Engine, Scene
from hugwbc.sim.robot_model import SIMULATION_TIMESTEP, load_model
from hugwbc.targets import HandTargets
from hugwbc.viz.drive_keys import HIDE, TASK
from hugwbc.viz.drive_link import HOST, SILENT_TIME, DriveLink, check_host, page_address
from hugwbc.viz.live_source import LiveSource
from hugwbc.viz.marks import HAND_FORCE_SCALE
from hugwbc.viz.shapes import colour_meshes, shapes_of

HANDS_AT_FIRST = {"left": (0.35, 0.25, 0.15), "right": (0.35, -0.25, 0.15)}  # [m], in the heading frame
PUSH_FORCE, PUSH_TIME = 150.0, 0.2  # [N], [s]
CAMERA, LOOK_AT = (2.6, 1.2, 1.5), (0.0, 0.0, 0.85)  # [m]
SCENE_CAMERA = (-1.0, 2.8, 1.8)  # [m], from the side: what a robot works at is ahead of it
GONE_TIME = 2.0  # [s]; a page that says nothing for longer is given up
FOLLOW_TIME = 0.3  # [s], time constant with which the camera follows
HEIGHT_STEP = 0.05  # [m], of one press of the keys for lower and higher
CAMERA_MODES = ("follows", "turns along", "stays")
# The actions that end a task, and what is said of it.
ENDS = {"stop": "stop was pressed", "reset": "reset was pressed", HIDE: "the page was hidden or closed"}
NAMES = {"v_x": "forward", "v_y": "left", "omega": "turn", "f": "stride", "l": "swing", "h": "height", "p": "pitch",
         "w": "waist"}  # fmt: skip
# In the light theme and in the dark one.
FLOOR_COLOURS = {
    "plane_color": ((238, 241, 245), (58, 64, 74)),
    "cell_color": ((208, 213, 220), (80, 88, 100)),
    "section_color": ((168, 175, 186), (108, 117, 131)),
}
_STREAM = "another program drives: the sliders show its commands"
WORLD = "/world"  # everything that stands still for the robot; it moves instead of the cameras


class LivePage:
    """A page on which a person drives one robot."""

    def __init__(
        self,
        simulation: Engine,
        *,
        name: str,
        host: str = HOST,
        port: int = 0,
        expose: bool = False,
        tasks: Sequence[str] = (),
        stream: SocketSource | None = None,
    ) -> None:
        """Build the page and listen.

        Args:
            simulation: the robot.
            name: name of the controller, for the title.
            host: host to listen on.
            port: port to listen on; 0 for any free port.
            expose: allow a host that other machines can reach, and requests that call this machine by any name.
            tasks: names of tasks to offer; whoever runs the robot asks `take_task` for the one that is requested.
            stream: another program's commands. While they come, the sliders follow them and cannot be moved.
        """
        check_host(host, expose=expose)
        commands = [(key, NAMES[key], COMMAND_UNITS[key]) for key in COMMAND_NAMES]
        title = f"hugwbc: {name}"
        gaits = [gait.label for gait in Gait]
        self.link = DriveLink({"title": title, "gaits": gaits, "commands": commands, "tasks": list(tasks)})
        # viser prints the address; what is printed is for the caller to decide.
        with self.link.serving(any_host=expose), contextlib.redirect_stdout(io.StringIO()):
            self.server = viser.ViserServer(host, port, label=title, verbose=False)
        self.source = LiveSource(simulation.robot, stream=stream)  # what the person asks for, for the control loop
        self._following = False  # as the sliders show it
        self.push: np.ndarray | None = None  # force that waits, in the pelvis' heading frame [N], (3,)
        self._actions: set[str] = set()
        self._moved: set[str] = set()  # sliders that do not show the command
        self._driven: dict[str, float] = {}  # by keys and sticks, at the last picture
        self._abandoned, self._missed = True, ""
        self._camera, self._view, self._shown = CAMERA_MODES[0], np.zeros(3), 0.0
        # The page draws MuJoCo's model of the robot, whichever engine moves it.
        self._model = load_model(SIMULATION_TIMESTEP, robot=simulation.robot)
        self._drawn = mujoco.MjData(self._model)
        self._kinematics = Kinematics(simulation.robot)
        self._dark: bool | None = None
        self._build_scene(self._model)
        self._theme(dark=False)
        self._build_objects(simulation.scene)
        self._build_panel()
        self.show(simulation)

    @property
    def address(self) -> str:
        """The address of the page, for a browser."""
        return page_address(self.server.get_host(), self.server.get_port())

    def _build_scene(self, model: mujoco.MjModel) -> None:
        scene = self.server.scene
        scene.set_up_direction("+z")
        self._world = scene.add_frame(WORLD, show_axes=False)
        self._floor = scene.add_grid(
            f"{WORLD}/floor", 200.0, 200.0, plane="xy", cell_size=0.5, section_size=1.0, plane_opacity=1.0
        )
        self.server.initial_camera.position = CAMERA
        self.server.initial_camera.look_at = LOOK_AT
        self._links = {}
        for link, meshes in colour_meshes(shapes_of(model)).items():
            self._links[link] = self._add_body(f"{WORLD}/robot/{link}", meshes)
        self._heading = scene.add_frame(f"{WORLD}/heading", show_axes=False)
        self._handles = {}
        for side in SIDES:
            self._handles[side] = scene.add_transform_controls(
                f"{WORLD}/heading/{side}_hand", 0.25, disable_rotations=True, disable_sliders=True, depth_test=False,
                position=HANDS_AT_FIRST[side], visible=False,
            )  # fmt: skip
            self._handles[side].on_update(lambda _: self._take_hands())
            scene.add_icosphere(f"{WORLD}/heading/{side}_hand/ball", 0.035, (224, 112, 42), opacity=0.7)

    def _add_body(self, path: str, meshes: Mapping[str, Any], *, flat_shading: bool = False) -> viser.FrameHandle:
        """Draw a body, whose meshes have one colour each; return the frame that moves it."""
        frame = self.server.scene.add_frame(path, show_axes=False)
        for part, (colour, mesh) in enumerate(meshes.items()):
            self.server.scene.add_mesh_simple(
                f"{path}/{part}",
                mesh.vertices,
                mesh.faces,
                color=ImageColor.getrgb(colour)[:3],
                flat_shading=flat_shading,
            )
        return frame

    def _build_objects(self, around: Scene | None) -> None:
        """Draw what stands around the robot."""
        self._objects: list[viser.SceneNodeHandle] = []
        self._forces: dict[str, viser.SceneNodeHandle] = {}
        model = None if around is None else around.model()
        if around is None or model is None:
            return
        self.server.initial_camera.position = SCENE_CAMERA
        meshes = colour_meshes(shapes_of(model))
        for number, body in enumerate(("world", *around.body_names)):  # what an MJCF file has in its world stays there
            self._objects.append(self._add_body(f"{WORLD}/objects/{number}", meshes.get(body, {}), flat_shading=True))

    def stage(self, simulation: Engine) -> None:
        """Show another robot of the same kind among its own objects, and forget earlier requests."""
        with self.server.atomic():
            for shown in (*self._objects, *self._forces.values()):
                shown.remove()
            self._build_objects(simulation.scene)
        self._actions.clear()
        self._missed = ""
        self.push = None

    def _show_objects(self, simulation: Engine, drawn: mujoco.MjData) -> str:
        """Draw the objects and the forces on the hands; return a line that says how large these are."""
        for frame, pose in zip(self._objects[1:], simulation.objects.poses, strict=True):
            frame.position, frame.wxyz = pose[:3], pose[3:]
        force = simulation.state().hand_force
        if simulation.scene is None or force is None:
            return ""
        for side, pushed in zip(SIDES, force, strict=True):
            hand = drawn.site(f"{side}_hand").xpos
            points = np.stack((hand - HAND_FORCE_SCALE * pushed, hand))[None]
            name = f"{WORLD}/forces/{side}_hand"
            self._forces[side] = self.server.scene.add_line_segments(name, points, (209, 56, 75))
        return f", hands {np.linalg.norm(force[0]):.0f} and {np.linalg.norm(force[1]):.0f} N"

    def _theme(self, *, dark: bool) -> None:
        self._dark = dark
        for part, (light, night) in FLOOR_COLOURS.items():
            setattr(self._floor, part, night if dark else light)
        # viser's share button would open the page to everybody.
        self.server.gui.configure_theme(dark_mode=dark, show_logo=False, show_share_button=False)

    def _build_panel(self) -> None:
        gui, of_gaits = self.server.gui, [command_ranges(gait, self.source.robot) for gait in Gait]
        self._sliders = {}
        for name in COMMAND_NAMES:
            low, high = zip(*(ranges[name].finishing for ranges in of_gaits), strict=True)
            value = getattr(self.source.requested, name)
            slider = gui.add_slider(f"{NAMES[name]} {name} [{COMMAND_UNITS[name]}]", min(low), max(high), 0.01, value)
            slider.on_update(lambda _, name=name: self._ask(name))
            self._sliders[name] = slider
        with gui.add_folder("hands"):
            self._hands_on = gui.add_checkbox("drag the hands", False)
            self._body_on = gui.add_checkbox("whole body helps", False)
        for box in (self._hands_on, self._body_on):
            box.on_update(lambda _: self._take_hands())
        with gui.add_folder("disturb"):
            for label, force in (("push from the left", -PUSH_FORCE), ("push from behind", 0.0)):
                vector = np.array([0.0, force, 0.0]) if force else np.array([PUSH_FORCE, 0.0, 0.0])
                gui.add_button(label).on_click(lambda _, vector=vector: self._push(vector))

    @property
    def _attended(self) -> bool:
        """Whether a page is there from which a person can stop the robot; viser's own connection does not count."""
        return not self.link.closed and self.link.silence() <= GONE_TIME

    def _push(self, force: np.ndarray) -> None:
        """Let a force [N] push the robot at the next picture, one at a time."""
        if self._attended:
            self.push = force

    def _ask(self, name: str) -> None:
        """Ask for a slider's value; `show` moves the slider back if the gait does not admit that value.

        Moving it back here would have no effect: viser passes the slider's value on to all other pages, and this
        message replaces the one that would move it back.
        """
        value = float(self._sliders[name].value)
        if value == getattr(self.source.requested, name):
            return
        if self._attended:
            self.source.ask(name, value)
        if getattr(self.source.requested, name) != value:
            self._moved.add(name)

    def _show_sliders(self) -> None:
        for name, slider in self._sliders.items():
            slider.value = getattr(self.source.requested, name)

    def _take_hands(self) -> None:
        on = bool(self._hands_on.value) and self._attended
        for handle in self._handles.values():
            handle.visible = on
        left, right = (np.array(self._handles[side].position, dtype=float) for side in SIDES)
        self.source.hands = HandTargets(left, right, "heading", whole_body=bool(self._body_on.value)) if on else None

    def take(self, action: str) -> bool:
        """Return whether an action, such as "reset", was requested since the last call."""
        requested = action in self._actions
        self._actions.discard(action)
        return requested

    def take_task(self) -> str | None:
        """Return the task requested since the last call; None if there is none."""
        tasks = sorted(action for action in self._actions if action.startswith(TASK))
        self._actions.difference_update(tasks)
        return tasks[0].removeprefix(TASK) if tasks else None

    @property
    def interruption(self) -> str:
        """Why a task must stop: the person asked for it since the page was staged, or is gone; empty to go on."""
        return next((reason for action, reason in ENDS.items() if action in self._actions), self._missed)

    def moved(self) -> None:
        """Show the command on the sliders, after it was changed elsewhere."""
        self._moved.update(COMMAND_NAMES)

    def _obey(self, action: str) -> None:
        """Do what a key or a button asks for."""
        if action in (gait.label for gait in Gait):
            self.source.ask_gait(Gait.parse(action))
            self._show_sliders()
        elif action in ("stop", HIDE):
            if action == "stop":
                self.source.stop()
            else:
                self.source.halt(f"{ENDS[HIDE]}: the robot was stopped")
            self._show_sliders()
            self._actions.add(action)
        elif action == "camera":
            self._camera = CAMERA_MODES[(CAMERA_MODES.index(self._camera) + 1) % len(CAMERA_MODES)]
        elif action == "push":
            self._push(np.array([0.0, -PUSH_FORCE, 0.0]))
        elif action in ("lower", "higher"):
            step = HEIGHT_STEP if action == "higher" else -HEIGHT_STEP
            self.source.ask("h", round(self.source.requested.h + step, 2))
            self._show_sliders()
        else:
            self._actions.add(action)

    def _steer(self) -> None:
        """Apply keys, sticks and buttons, and stop the robot if the page is gone."""
        for action in self.link.take_actions():
            self._obey(action)
        driven = self.link.commands()
        if driven != self._driven:
            # What was held and is let go returns to rest; sliders that nobody overrides stay.
            for name, value in {**dict.fromkeys(self._driven, 0.0), **driven}.items():
                self.source.ask(name, value)
                self._moved.add(name)
            self._driven = driven
            if not driven:
                self.source.let_go()
        silence, gone = self.link.silence(), not self._attended
        # Whatever asks for a motion while no page is there is stopped too.
        if gone and (not self._abandoned or self.source.requested.gait is not Gait.STANDING):
            self.source.halt("the page is gone: the robot was stopped")
            self._moved.update(VELOCITY_NAMES)
            self._driven = {}
        # A busy computer may keep a page from speaking for a moment; the robot then waits and continues.
        self.source.pause(on=gone or silence > SILENT_TIME)
        # A task has no such pause: whoever runs it stops it (`interruption`).
        if gone and not self._missed:
            self._missed = ENDS[HIDE] if self.link.closed else f"the page was silent for {GONE_TIME:g} s"
        self._abandoned = gone

    def disturb(self, simulation: Engine) -> None:
        """Apply the push that is waiting."""
        if self.push is not None:
            turn = rotations.rotation_z(simulation.state().yaw)
            simulation.apply_force(turn @ self.push, PUSH_TIME)
            self.push = None

    def show(self, simulation: Engine, task: str = "", speed: float = 1.0, commanded: Command | None = None) -> None:
        """Draw the robot and its objects, show its state, and take the person's requests.

        The task is the one that the robot does, empty while the person drives; the speed is simulated time over real
        time. `commanded` is what the loop commands, which differs from the source's where the body helps the hands.
        """
        self._steer()
        if self.link.dark is not None and self.link.dark != self._dark:
            self._theme(dark=self.link.dark)
        drawn, state = self._drawn, simulation.state()
        drawn.qpos[:] = simulation.qpos
        mujoco.mj_kinematics(self._model, drawn)
        assert state.position is not None and state.velocity is not None
        forces = ""
        with _drawn_later(), self.server.atomic():
            for link, handle in self._links.items():
                handle.position, handle.wxyz = drawn.body(link).xpos, drawn.body(link).xquat
            forces = self._show_objects(simulation, drawn)
            self._heading.position = state.position
            self._heading.wxyz = rotations.from_yaw_pitch_roll(state.yaw, 0.0, 0.0)
            self._follow(state.position, state.yaw, state.time)
        self._show_who_drives()
        with _drawn_later():
            while self._moved:
                name = self._moved.pop()
                self._sliders[name].value = getattr(self.source.requested, name)
        self._say(simulation, forces, task, speed, commanded or self.source.command)

    def _show_who_drives(self) -> None:
        """Let the sliders follow another program's commands while these come, and be locked for people meanwhile."""
        following, requested = self.source.following, self.source.requested
        if following is not self._following:
            self._following = following
            self._hands_on.value = False
            for control in (*self._sliders.values(), self._hands_on, self._body_on):
                control.disabled = following
            self.moved()
        if following:
            self._moved.update(name for name in COMMAND_NAMES if self._sliders[name].value != getattr(requested, name))

    def _follow(self, position: np.ndarray, yaw: float, now: float) -> None:
        """Move the world so that cameras, which stay, keep the robot in view.

        Every person can turn and zoom their own camera meanwhile, and several pages see the same.
        """
        share = 1.0 - math.exp(-max(0.0, now - self._shown) / FOLLOW_TIME)
        if now < self._shown or np.linalg.norm(position[:2] - self._view[:2]) > 3.0:  # a reset, or a camera let go
            share = 1.0
        self._shown = now
        if self._camera != "stays":
            self._view[:2] += share * (position[:2] - self._view[:2])
            turn = yaw - self._view[2] if self._camera == "turns along" else 0.0
            self._view[2] += share * math.remainder(turn, 2.0 * math.pi)
        self._world.wxyz = rotations.from_yaw_pitch_roll(-self._view[2], 0.0, 0.0)
        self._world.position = -rotations.rotation_z(-self._view[2]) @ np.array([*self._view[:2], 0.0])

    def _say(self, simulation: Engine, forces: str, task: str, speed: float, commanded: Command) -> None:
        """Tell the pages what to display."""
        state, requested, command = simulation.state(), self.source.requested, self.source.command
        assert state.position is not None
        self._kinematics.update(state)
        measured = self._kinematics.measured(simulation.ground_height(state.position[:2]))
        allowed, changes = feasible(commanded.clamp(simulation.robot)[0], simulation.robot)
        gait = command.gait.label
        coming = "" if requested.gait is command.gait else f", slows down for {requested.gait.label}"
        notice = self.source.notice if time.monotonic() < self.source.noticed else ""
        whose = _STREAM if self.source.following else ""
        about = f"{speed:.2f} × real time, pelvis {state.position[2]:.2f} m{forces}"
        status: dict[str, Any] = {
            "gait": gait,
            "next": requested.gait.label,
            "line": f"{gait.replace('_', ' ')} at {state.time:.1f} s{coming}, {about}",
            "notes": [note for note in (whose, notice, *(f"guard: {change}" for change in changes)) if note],
            "asked": {name: getattr(requested, name) for name in COMMAND_NAMES},
            "commanded": {name: getattr(allowed, name) for name in COMMAND_NAMES},
            "changed": [change.name for change in changes],
            "measured": {name: float(getattr(measured, name)) for name in MEASURED_NAMES},
            "camera": self._camera,
            "follows": self._camera != "stays",
        }
        if task:  # the task commands the robot, not the person
            line = f"{task.replace('_', ' ')} at {state.time:.1f} s, {about}"
            status |= {"task": task, "line": line, "notes": [notice] if notice else [], "gait": "", "next": ""}
            status |= {"asked": {}, "commanded": {}, "changed": []}
        self.link.say(**finite_json(status))

    def close(self) -> None:
        """Stop listening."""
        with contextlib.redirect_stdout(io.StringIO()):
            self.server.stop()


@contextlib.contextmanager
def _drawn_later() -> Iterator[None]:
    """Leave what is left of a picture to the next one if viser stumbles over its own threads.

    It wakes the task that sends from the thread that draws, without a lock; rarely, that task begins to wait at the
    same moment. The message itself is kept, and a robot must not stop for it.
    """
    try:
        yield
    except RuntimeError as error:
        if "mutated during iteration" not in str(error):
            raise
