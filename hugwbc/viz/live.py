"""The live page: drive a robot by sliders, gait buttons, a push, and draggable hand targets. Needs viser.

The page's server answers only browsers that ask this machine for it by its own name, and only its own page. A server on
127.0.0.1 is still within reach of every page that the user's browser has open: a page of another site may open a web
socket to it (the browser says so in `Origin`, and leaves it to the server to check), or may have its own name point to
127.0.0.1 and so count as the same site (then `Host` has that name).
"""

import contextlib
import functools
import http
import io
import ipaddress
import threading
import urllib.parse
from collections.abc import Callable, Iterator
from typing import Any

import mujoco
import numpy as np
import trimesh
import viser
import websockets.asyncio.server as server
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from hugwbc import rotations
from hugwbc.commands import COMMAND_NAMES, COMMAND_UNITS, Command, command_ranges
from hugwbc.errors import ConfigError
from hugwbc.gait import Gait
from hugwbc.robot import SIDES
from hugwbc.sim import Engine, Scene
from hugwbc.sim.robot_model import SIMULATION_TIMESTEP, load_model
from hugwbc.targets import HandTargets
from hugwbc.viz.live_source import LiveSource
from hugwbc.viz.marks import HAND_FORCE_SCALE
from hugwbc.viz.shapes import VISUAL_GROUP, colour_of, drawn_geoms, homogeneous, mesh_of

HOST = "127.0.0.1"
HANDS_AT_FIRST = {"left": (0.35, 0.25, 0.15), "right": (0.35, -0.25, 0.15)}  # [m], in the heading frame
PUSH_FORCE, PUSH_TIME = 150.0, 0.2  # [N], [s]
CAMERA, LOOK_AT = (2.6, 1.2, 1.5), (0.0, 0.0, 0.85)  # [m]
SCENE_CAMERA = (-1.0, 2.8, 1.8)  # [m], from the side: what a robot works at is ahead of it
_NAMES = {"v_x": "forward", "v_y": "left", "omega": "turn", "f": "stride", "l": "swing", "h": "height", "p": "pitch",
          "w": "waist"}  # fmt: skip
OWN_NAMES = ("127.0.0.1", "localhost", "::1")
ProcessRequest = Callable[[server.ServerConnection, Request], Response | None]
_starting = threading.Lock()


def check_host(host: str, *, expose: bool) -> str:
    """Return the host to listen on, unchanged.

    Args:
        host: name or address of the host.
        expose: whether other machines may reach it.

    Raises:
        ConfigError: if other machines can reach the host and `expose` is not set.
    """
    try:
        loopback = host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        loopback = False
    if not loopback and not expose:
        raise ConfigError(
            f"host is {host}: other machines could drive the robot; give {HOST}, or --expose if that is meant"
        )
    return host


def refusal(headers: Headers, *, any_host: bool) -> str | None:
    """Return why a request must not be answered; None if it may be.

    Args:
        headers: headers of the request.
        any_host: whether the request may call this machine by any name.
    """
    hosts, origins = headers.get_all("Host"), headers.get_all("Origin")
    if len(hosts) != 1 or len(origins) > 1:
        return "one Host and at most one Origin, please"
    if not any_host and _hostname(f"//{hosts[0]}") not in OWN_NAMES:
        return f"this page is at {OWN_NAMES[0]}, not at {hosts[0]}"
    if origins and origins[0] not in (f"http://{hosts[0]}", f"https://{hosts[0]}"):
        return f"pages of {origins[0]} may not drive this robot"
    return None


def _hostname(url: str) -> str | None:
    try:
        return urllib.parse.urlsplit(url).hostname
    except ValueError:
        return None


@contextlib.contextmanager
def guarded(*, any_host: bool) -> Iterator[None]:
    """Make a web socket server that starts within this context refuse what `refusal` refuses.

    viser starts its server in its constructor and offers no hook to check requests, so the function that starts servers
    is replaced for the time of the context.

    Args:
        any_host: whether requests may call this machine by any name.

    Raises:
        ConfigError: if no server was started through the replaced function, because its requests would go unchecked.
    """
    original, started = server.serve, []

    @functools.wraps(original)
    def serve(*arguments: Any, process_request: ProcessRequest | None = None, **options: Any) -> server.serve:  # noqa: ANN401  as websockets'
        def checked(connection: server.ServerConnection, request: Request) -> Response | None:
            reason = refusal(request.headers, any_host=any_host)
            if reason is not None:
                return connection.respond(http.HTTPStatus.FORBIDDEN, f"{reason}\n")
            return None if process_request is None else process_request(connection, request)

        started.append(True)
        return original(*arguments, process_request=checked, **options)

    with _starting:
        server.serve = serve  # type: ignore[assignment,misc]
        try:
            yield
        finally:
            server.serve = original  # type: ignore[misc]
    if not started:
        raise ConfigError("this version of viser starts its server in another way; install the one of constraints.txt")


def page_address(host: str, port: int) -> str:
    """Return the address of a page for a browser, which requires brackets around an IPv6 address."""
    return f"http://[{host}]:{port}" if ":" in host else f"http://{host}:{port}"


def link_meshes(model: mujoco.MjModel, link: str) -> dict[str, trimesh.Trimesh]:
    """Return the visual shapes of a link in its frame, as one mesh for each material, by the material's name."""
    body = model.body(link).id
    parts: dict[str, list[trimesh.Trimesh]] = {}
    for geom in np.flatnonzero((model.geom_group == VISUAL_GROUP) & (model.geom_bodyid == body)):
        part = _primitive(int(model.geom_type[geom]), model.geom_size[geom])
        part.apply_transform(homogeneous(model.geom_pos[geom], model.geom_quat[geom]))
        parts.setdefault(model.mat(model.geom_matid[geom]).name, []).append(part)
    return {material: _joined(shapes) for material, shapes in parts.items()}


def object_meshes(model: mujoco.MjModel, body: str) -> list[tuple[tuple[int, int, int], trimesh.Trimesh]]:
    """Return the shapes of a body of a scene's model in its frame, one mesh for each colour (three numbers to 255)."""
    parts: dict[tuple[int, int, int], list[trimesh.Trimesh]] = {}
    for geom in drawn_geoms(model):
        if model.geom_bodyid[geom] == model.body(body).id:
            part = _primitive(int(model.geom_type[geom]), model.geom_size[geom])
            if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
                part = trimesh.Trimesh(*mesh_of(model, geom), process=False)
            part.apply_transform(homogeneous(model.geom_pos[geom], model.geom_quat[geom]))
            red, green, blue = (round(255 * value) for value in colour_of(model, geom))
            parts.setdefault((red, green, blue), []).append(part)
    return [(colour, _joined(shapes)) for colour, shapes in parts.items()]


def _joined(parts: list[trimesh.Trimesh]) -> trimesh.Trimesh:
    first = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    return trimesh.Trimesh(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.faces + start for part, start in zip(parts, first, strict=True)]),
        process=False,
    )


def _primitive(kind: int, size: np.ndarray) -> trimesh.Trimesh:
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return trimesh.creation.box(extents=2 * size)
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return trimesh.creation.cylinder(radius=size[0], height=2 * size[1], sections=24)
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return trimesh.creation.capsule(radius=size[0], height=2 * size[1], count=[16, 16])
    ball = trimesh.creation.icosphere(subdivisions=2, radius=1.0)
    ball.apply_scale(size if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID else size[0])
    return ball


class LivePage:
    """A page on which a person drives one robot.

    Attributes:
        source: the command source for the control loop, with what the person asks for.
        server: viser's server.
        pushes: forces that wait to be applied, in the pelvis' heading frame [N], each of shape (3,).
    """

    def __init__(self, simulation: Engine, *, name: str, host: str = HOST, port: int = 0, expose: bool = False) -> None:
        """Build the page and listen.

        Args:
            simulation: the robot.
            name: name of the controller, for the title.
            host: host to listen on.
            port: port to listen on; 0 for any free port.
            expose: allow a host that other machines can reach, and requests that call this machine by any name.

        Raises:
            ConfigError: if other machines can reach the host and `expose` is not set.
        """
        check_host(host, expose=expose)
        # viser prints the address; what is printed is for the caller to decide.
        with guarded(any_host=expose), contextlib.redirect_stdout(io.StringIO()):
            self.server = viser.ViserServer(host, port, label=f"hugwbc: {name}", verbose=False)
        self.source = LiveSource()
        self.pushes: list[np.ndarray] = []
        self._refused: set[str] = set()  # sliders whose value the gait does not admit
        # The page draws MuJoCo's model of the robot, whichever engine moves it.
        self._model = load_model(SIMULATION_TIMESTEP, robot=simulation.robot)
        self._drawn = mujoco.MjData(self._model)
        self._build_scene(self._model)
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
        scene.add_grid("/floor", 40.0, 40.0, plane="xy", cell_size=0.5, section_size=1.0, plane_opacity=0.5)
        self.server.initial_camera.position = CAMERA
        self.server.initial_camera.look_at = LOOK_AT
        bodies = [model.body(index).name for index in range(1, model.nbody)]
        drawn = {model.body(int(b)).name for b in model.geom_bodyid[model.geom_group == VISUAL_GROUP]}
        self._links = {}
        for link in (link for link in bodies if link in drawn):
            self._links[link] = scene.add_frame(f"/robot/{link}", show_axes=False)
            for material, mesh in link_meshes(model, link).items():
                rgb = tuple(np.round(255 * model.mat(material).rgba[:3]).astype(int).tolist())
                scene.add_mesh_simple(f"/robot/{link}/{material}", mesh.vertices, mesh.faces, color=rgb)
        self._heading = scene.add_frame("/heading", show_axes=False)
        self._handles = {}
        for side in SIDES:
            self._handles[side] = scene.add_transform_controls(
                f"/heading/{side}_hand", 0.25, disable_rotations=True, disable_sliders=True, depth_test=False,
                position=HANDS_AT_FIRST[side], visible=False,
            )  # fmt: skip
            self._handles[side].on_update(lambda _: self._take_hands())
            scene.add_icosphere(f"/heading/{side}_hand/ball", 0.035, (224, 112, 42), opacity=0.7)

    def _build_objects(self, around: Scene | None) -> None:
        """Draw what stands around the robot, and lines for the forces on its hands."""
        self._objects, model = [], None if around is None else around.model()
        if around is None or model is None:
            return
        self.server.initial_camera.position = SCENE_CAMERA
        for number, body in enumerate(("world", *around.body_names)):  # what an MJCF file has in its world stays there
            frame = self.server.scene.add_frame(f"/objects/{number}", show_axes=False)
            for part, (colour, mesh) in enumerate(object_meshes(model, body)):
                self.server.scene.add_mesh_simple(
                    f"/objects/{number}/{part}", mesh.vertices, mesh.faces, color=colour, flat_shading=True
                )
            self._objects.append(frame)

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
            self.server.scene.add_line_segments(f"/forces/{side}_hand", points, (209, 56, 75))
        return f", hands {np.linalg.norm(force[0]):.0f} and {np.linalg.norm(force[1]):.0f} N"

    def _build_panel(self) -> None:
        gui = self.server.gui
        self._readings = gui.add_markdown("")
        self._gaits = gui.add_button_group("gait", [gait.label for gait in Gait])
        self._gaits.on_click(lambda event: self._choose_gait(Gait.parse(str(event.target.value))))
        self._sliders = {}
        for name in COMMAND_NAMES:
            low, high = _slider_range(name)
            slider = gui.add_slider(
                f"{_NAMES[name]} {name} [{COMMAND_UNITS[name]}]", low, high, 0.01, getattr(Command(), name)
            )
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
                gui.add_button(label).on_click(lambda _, vector=vector: self.pushes.append(vector))
            gui.add_button("stop").on_click(lambda _: self.stop())

    def _ask(self, name: str) -> None:
        """Ask for a slider's value; `show` moves the slider back if the gait does not admit that value.

        Moving it back here would have no effect: viser passes the slider's value on to all other pages, and this
        message replaces the one that would move it back.
        """
        asked = float(self._sliders[name].value)
        self.source.ask(name, asked)
        if getattr(self.source.wanted, name) != asked:
            self._refused.add(name)

    def _choose_gait(self, gait: Gait) -> None:
        self.source.ask_gait(gait)
        for name, slider in self._sliders.items():
            slider.value = getattr(self.source.wanted, name)

    def _take_hands(self) -> None:
        on = bool(self._hands_on.value)
        for handle in self._handles.values():
            handle.visible = on
        left, right = (np.array(self._handles[side].position, dtype=float) for side in SIDES)
        self.source.hands = HandTargets(left, right, "heading", whole_body=bool(self._body_on.value)) if on else None

    def stop(self) -> None:
        """Ask for zero velocities."""
        for name in ("v_x", "v_y", "omega"):
            self._sliders[name].value = 0.0
            self.source.ask(name, 0.0)

    def disturb(self, simulation: Engine) -> None:
        """Apply the pushes that are waiting."""
        while self.pushes:
            turn = rotations.rotation_z(simulation.state().yaw)
            simulation.apply_force(turn @ self.pushes.pop(0), PUSH_TIME)

    def show(self, simulation: Engine) -> None:
        """Draw the robot where it is, and say what it does."""
        drawn, state = self._drawn, simulation.state()
        drawn.qpos[:] = simulation.qpos
        mujoco.mj_kinematics(self._model, drawn)
        assert state.position is not None and state.velocity is not None
        with self.server.atomic():
            for link, handle in self._links.items():
                handle.position, handle.wxyz = drawn.body(link).xpos, drawn.body(link).xquat
            forces = self._show_objects(simulation, drawn)
            self._heading.position = state.position
            self._heading.wxyz = rotations.from_yaw_pitch_roll(state.yaw, 0.0, 0.0)
        while self._refused:
            name = self._refused.pop()
            self._sliders[name].value = getattr(self.source.wanted, name)
        velocity = rotations.rotation_z(-state.yaw) @ state.velocity
        self._readings.content = (
            f"**{self.source.wanted.gait.label}** at {state.time:.1f} s, "
            f"pelvis {state.position[2]:.2f} m, forward {velocity[0]:+.2f} m/s{forces}"
        )

    def close(self) -> None:
        """Stop listening."""
        with contextlib.redirect_stdout(io.StringIO()):
            self.server.stop()


def _slider_range(name: str) -> tuple[float, float]:
    """Return the least and the largest value that any gait admits."""
    ranges = [command_ranges(gait)[name].finishing for gait in Gait]
    return min(low for low, _ in ranges), max(high for _, high in ranges)
