"""States of the robot, and synthetic records of runs: with prescribed errors, or with moving parts for pictures."""

import dataclasses
import pathlib
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

from hugwbc import Command, Gait, JointCommand, Robot, RobotState, UpperBody, load_robot, rotations
from hugwbc.commands import COMMAND_SIGNS, MEASURED_NAMES
from hugwbc.evaluation.figures import Figure
from hugwbc.evaluation.intervals import Estimate
from hugwbc.robot import Mirror
from hugwbc.rotations import AXIAL_SIGNS, VECTOR_SIGNS
from hugwbc.runtime.control_period import ControlPeriod
from hugwbc.runtime.safety_report import SafetyReport
from hugwbc.runtime.trace import Trace

# A busy machine is no fault of what is tested.
settings.register_profile("patient", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("patient")


def make_state(q=None, *, yaw: float = 0.0, pitch: float = 0.0, roll: float = 0.0, **fields) -> RobotState:
    """Return a robot at rest in the nominal pose, but for its joints, the pelvis' angles [rad] and other fields."""
    q = load_robot().nominal if q is None else q
    state = {
        "q": q,
        "dq": np.zeros(np.size(q)),
        "orientation": rotations.from_yaw_pitch_roll(yaw, pitch, roll),
        "angular_velocity": np.zeros(3),
    }
    values = {name: value if value is None or np.isscalar(value) else np.array(value, dtype=float)
              for name, value in (state | fields).items()}  # fmt: skip
    return RobotState(**values)


QUATERNION_SIGNS = np.array([1.0, *AXIAL_SIGNS])  # of the reflected body: the rotation axis is an axial vector


def mirror_state(state: RobotState, mirror: Mirror) -> RobotState:
    """Return the mirror image of a state."""
    signs = {"orientation": QUATERNION_SIGNS, "angular_velocity": AXIAL_SIGNS, "position": VECTOR_SIGNS,
             "velocity": VECTOR_SIGNS}  # fmt: skip
    fields = {name: getattr(state, name) * sign for name, sign in signs.items() if getattr(state, name) is not None}
    force = None if state.foot_force is None else state.foot_force[::-1] * VECTOR_SIGNS
    return dataclasses.replace(state, q=mirror.joints(state.q), dq=mirror.joints(state.dq), foot_force=force, **fields)


def mirror_command(command: Command) -> Command:
    """Return the command whose execution is the mirror image of that of the given one."""
    return Command.from_array(command.array() * COMMAND_SIGNS, command.gait.mirrored())


def bad_state():
    return make_state(q=np.full(19, np.nan))


class Recorder:
    """A controller that remembers what it was given and answers what it was told to."""

    name, period = "recorder", 0.02

    def __init__(self):
        robot = load_robot()
        self.answer: Any = JointCommand.position(robot, robot.nominal)
        self.seen: list[tuple[RobotState, Command, UpperBody]] = []
        self.resets = 0

    def reset(self, state):
        self.resets += 1

    def act(self, state, command, upper_body):
        self.seen.append((state, command, upper_body))
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer


class ByHand:
    """A control period outside a loop: the test gives the state, the command and the arm targets."""

    solution = None

    def __init__(self, controller, robot: Robot | None = None):
        robot = robot or load_robot()
        self.control = ControlPeriod(controller, self, None, robot=robot, estimator=None, upper_body=self)  # type: ignore[arg-type]
        self.report = self.control.log.report

    def start(self, state):
        self.control.start(state, 0.0)

    def act(self, state, command, arms):
        self._asked = arms, command
        self.control.observe(state, 0.0)
        return self.control.decide(0.0)

    def command_at(self, t):
        return Command()

    def hands_at(self, t):
        return None

    def reset(self):
        pass

    def update(self, state, hands, command, dt, commanded=None, followed=None):
        return self._asked


def figure(value, low, high, *, paper=None, controller="a", quantity="E_h", published=None, higher=False) -> Figure:
    """Return a figure of a made-up table, with its 95 % interval; None as the estimate of a published one."""
    estimate = None if published is not None else Estimate(value, low, high, 8)
    return Figure(
        "T", quantity, "m", estimate, paper, controller=controller, published=published, higher_is_better=higher
    )


@pytest.fixture(scope="session")
def exported_h1(tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    """The H1's shipped policy as an ONNX file, `h1.onnx`, in a folder of its own."""
    from hugwbc.learned.policy import load_policy  # seconds, which most tests do without
    from hugwbc.learned.policy.onnx_export import export_onnx

    path = tmp_path_factory.mktemp("export") / "folder" / "h1.onnx"
    assert export_onnx(load_policy("h1"), path) <= 1e-5
    return path


@pytest.fixture
def robot() -> Robot:
    return load_robot()


@pytest.fixture
def nominal_state() -> RobotState:
    return make_state()


def _synthetic_trace(
    command: Command | None = None,
    *,
    duration: float = 10.0,
    bias: dict[str, float] | None = None,
    frequency: float | None = None,
    apex: float | None = None,
    **fields,
) -> Trace:
    """Return a record that executes a command exactly, apart from the prescribed deviations.

    Feet touch down every 1 / frequency seconds, the right one half a cycle later, and each swing rises to the apex.
    """
    command = command or Command(gait=Gait.WALKING)
    frequency = command.f if frequency is None else frequency
    apex = command.l if apex is None else apex
    time = np.arange(round(duration * 50)) / 50
    n = time.size
    measured = np.stack(
        [np.full(n, getattr(command, name) + (bias or {}).get(name, 0.0)) for name in MEASURED_NAMES], axis=1
    )
    offsets = (0.0, 0.5)
    phases = [(time * frequency + offset) % 1.0 for offset in offsets]
    clearance = np.stack([apex * np.clip(np.sin(np.pi * (phase - 0.5) / 0.5), 0.0, None) for phase in phases], axis=1)
    downs = tuple(np.arange(1.0 - offset, duration * frequency) / frequency for offset in offsets)
    counts = [len(times) for times in fields.get("touch_downs", downs)]
    values = {
        "name": "synthetic",
        "time": time,
        "command": np.tile(command.array(), (n, 1)),
        "gait": np.full(n, int(command.gait)),
        "measured": measured,
        "clearance": clearance,
        "foot_contact": clearance <= 0.0,
        "phase": phases[1],
        "reachable": np.zeros((n, 2), dtype=bool),
        "tick_ms": np.full(n, 0.1),
        "ik_ms": np.zeros(n),
        "touch_downs": downs,
        "touch_down_velocity": tuple(np.tile([0.3, 0.0, -0.4], (count, 1)) for count in counts),
        "stance_peak": tuple(np.full(count, 900.0) for count in counts),
        "mass": load_robot().mass,
        "fell": False,
        "survived_s": duration,
        "steps": n,
        "safety": SafetyReport(ticks=n),
    }
    zeros = {"foot_force": (2, 3), "qpos": (26,), "qvel": (25,), "target": (19,), "torque": (19,), "power": ()}
    values |= {name: np.zeros((n, *shape)) for name, shape in zeros.items()}
    unknown = {"pressure_centre": (2, 3), "foothold": (2, 2), "hand_target_world": (2, 3), "arm_target": (8,)}
    values |= {name: np.full((n, *shape), np.nan) for name, shape in (unknown | {"hand_error": (2,)}).items()}
    return Trace(**{**values, **fields})


def _run(name: str = "qp", seconds: float = 1.0, seed: int = 0, *, hands: bool = True, fell: bool = False) -> Trace:
    """Return a record of a robot that moves ahead and turns: half a second on each foot, hand targets half the time."""
    rng = np.random.default_rng(seed)
    robot = load_robot()
    time = np.arange(round(seconds * 50)) / 50
    count = len(time)
    orientation = np.array([rotations.from_yaw_pitch_roll(yaw, 0.1, 0.0) for yaw in 0.4 * time])
    position = np.column_stack((0.5 * time, np.zeros(count), np.full(count, 0.95)))
    joints = robot.nominal + 0.2 * np.sin(time)[:, None] * rng.uniform(-1, 1, 19)
    targets = position[:, None] + rng.uniform(0.2, 0.4, (count, 2, 3))
    targets[: count // 2] = np.nan
    if not hands:
        targets[:] = np.nan
    # The left foot swings first; the foot in the air has a foothold.
    phase = time % 1.0
    contact = np.stack((phase >= 0.5, phase < 0.5), axis=1)
    feet = position[:, None] + np.array([[0.05, 0.2, -0.95], [0.05, -0.2, -0.95]])
    return _synthetic_trace(
        Command(v_x=0.5, omega=0.4, f=2.0, l=0.15, p=0.1, gait=Gait.WALKING),
        duration=seconds,
        name=name,
        measured=np.tile([0.5, 0, 0.4, -0.03, 0.1, 0], (count, 1)) + 0.01 * rng.normal(size=(count, 6)),
        clearance=np.abs(rng.normal(size=(count, 2))) * 0.1,
        phase=phase,
        foot_contact=contact,
        foot_force=np.where(contact[..., None], [0.0, 30.0, 500.0], 0.0),
        pressure_centre=np.where(contact[..., None], feet, np.nan),
        foothold=np.where(contact[..., None], np.nan, feet[..., :2] + 0.1),
        touch_downs=(np.arange(0.5, seconds, 1.0), np.arange(1.0, seconds, 1.0)),
        qpos=np.hstack((position, orientation, joints)),
        hand_target_world=targets,
        arm_target=np.where(np.isfinite(targets[:, 0, :1]), joints[:, robot.arms] + 0.1, np.nan),
        hand_error=np.linalg.norm(targets - position[:, None], axis=2),
        torque=rng.normal(size=(count, 19)),
        fell=fell,
    )


@pytest.fixture
def synthetic_trace() -> Callable[..., Trace]:
    """The function that makes a record with prescribed errors: `synthetic_trace(command, bias={"v_x": 0.1})`."""
    return _synthetic_trace


@pytest.fixture
def make_run() -> Callable[..., Trace]:
    """The function that makes a record for pictures, with hand targets in its second half unless `hands` is False."""
    return _run


@pytest.fixture
def standing_task(tmp_path: pathlib.Path) -> Callable[..., pathlib.Path]:
    """Return a writer of a file with a task, in which the robot stands before a wall, and its only milestone."""

    def write(milestone: str = "Milestone('never', lambda record: 0.0)", name: str = "stand") -> pathlib.Path:
        path = tmp_path / f"{name}.py"
        path.write_text(
            "from hugwbc.behaviours import wait\n"
            "from hugwbc.sim import Scene\n"
            "from hugwbc.sim.scenes import Wall\n"
            "from hugwbc.tasks import Milestone, Task\n"
            "scene = Scene((Wall(name='wall', position=(2.0, 0.0)),))\n"
            f"TASK = Task(name='{name}', about='Stand.', scene=scene, limit=1.5,\n"
            "    behaviour=lambda view, shapes: wait(view, 0.1),\n"
            f"    milestones=({milestone},))\n"
        )
        return path

    return write
