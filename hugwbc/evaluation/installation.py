"""Check an installation by trying its parts: versions, robot models, controllers, training environment."""

import dataclasses
import functools
import importlib.metadata
import importlib.util
import platform
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from hugwbc.errors import ConfigError, HugwbcError
from hugwbc.robot_tables import DEFAULT_ROBOT

if TYPE_CHECKING:
    from hugwbc.commands import Command
    from hugwbc.runtime import Trace
    from hugwbc.targets import HandTargets

PACKAGES = ("mujoco", "pin", "placo", "proxsuite", "numpy", "meshcat", "tyro")
LEARNED = ("torch", "safetensors")  # of the extra [learned]
WITHOUT_TORCH = "left out: torch is not installed; `pip install 'hugwbc[learned]'` brings it"
_HAND_ERROR = 0.1  # [m], of a hand a second after its target has come
_SQUATTED = 0.03  # [m], of h two seconds after a squat was commanded
_REMEDY = (
    "bend the knees to 0.6 to 1.0 rad under `nominal`, lower the swing, such as with commands: "
    "{l: {finishing: [0.03, 0.08]}}, or correct `effort` and `velocity` of `drives`"
)
SAMPLES = 20  # random states on which the models are compared


def run_checks(on_progress: Callable[[float], object], robot: str | None) -> list[tuple[str, bool, str]]:
    """Run every check, whether others fail or not; return what was checked, whether it is right, and what was found.

    With a robot, check that robot instead of the installation; if its table is wrong, nothing else of it.
    """
    checks = CHECKS if robot is None else {name: functools.partial(check, robot) for name, check in OF_A_ROBOT.items()}
    outcomes = []
    for index, (name, check) in enumerate(checks.items()):
        try:
            outcomes.append((name, True, check()))
        except (HugwbcError, ImportError) as error:
            outcomes.append((name, False, str(error)))
            if name == "table":  # the others need it
                break
        on_progress((index + 1) / len(checks))
    return outcomes


def check_table(name: str) -> str:
    """Check that the table of a robot is complete and plausible, and say what follows from it."""
    from hugwbc.robot import load_robot
    from hugwbc.robot_check import problems, tilted_axes
    from hugwbc.robot_tables import robot_table

    if found := problems(name):
        raise ConfigError("\n".join(found))
    robot = load_robot(name)
    (heel, toe), width = 100.0 * np.array(robot.sole_x), 100.0 * (robot.sole_y[1] - robot.sole_y[0])
    return (
        f"{len(robot.joint_names)} joints, {robot.mass:.2f} kg; pelvis at {robot.nominal_height:.3f} m, legs of "
        f"{robot.leg_length:.3f} m, soles from {heel:.1f} to {toe:.1f} cm and {width:.1f} cm wide; "
        f"held: {', '.join(robot.joint_names[i] for i in robot.held) or 'none'}"
        + "".join(f"; aside: {text}" for text in tilted_axes(robot_table(name)))
    )


def check_versions() -> str:
    """Check that every package that hugwbc needs is installed."""
    found = []
    for package in PACKAGES:
        try:
            found.append(f"{package} {importlib.metadata.version(package)}")
        except importlib.metadata.PackageNotFoundError:
            raise ConfigError(f"{package} is not installed; run `pip install hugwbc` again") from None
    found += [f"{name} {importlib.metadata.version(name)}" for name in LEARNED if _is_installed(name)]
    return f"Python {platform.python_version()}, {', '.join(found)}"


def check_arena() -> str:
    """Check that a robot can be put into the arena, and name its version, on which results depend."""
    from hugwbc.sim.arena import ENGINES, Arena

    arena = Arena()
    arena.simulation()
    engines = [name for name, kind in ENGINES.items() if kind.is_available()]
    parts = f"{arena.robot}, {arena.drives} drives, sensors {arena.sensing}, {arena.ground} ground"
    return f"{parts}, version {arena.version}; engines {', '.join(engines)}"


def check_agreement(robot: str = DEFAULT_ROBOT) -> str:
    """Check that MuJoCo's and Pinocchio's models agree in random states, and that no links touch in the nominal pose.

    They must agree in mass, in the joints' mass matrix, and in the positions of the hands.
    """
    import mujoco
    import pinocchio as pin

    from hugwbc.kinematics import Kinematics
    from hugwbc.robot import SIDES, load_robot
    from hugwbc.sim import Simulation

    simulation, rng = Simulation(robot=load_robot(robot)), np.random.default_rng(0)
    touching = {
        " and ".join(simulation.model.body(simulation.model.geom_bodyid[geom]).name for geom in contact.geom)
        for contact in simulation.data.contact
        if simulation.model.geom_bodyid[contact.geom].all()
    }
    if touching:
        raise ConfigError(
            f"in the nominal pose touch {'; '.join(sorted(touching))}; change `nominal` or their collision_box"
        )
    kinematics = Kinematics(simulation.robot)
    mass = float(simulation.model.body_mass.sum())
    worst = abs(sum(inertia.mass for inertia in kinematics.model.inertias) - mass)
    for _ in range(SAMPLES):
        q = rng.uniform(simulation.robot.lower, simulation.robot.upper)
        state = simulation.reset(xy=(1.0, -2.0), yaw=float(rng.uniform(-3.0, 3.0)), q=q)
        kinematics.update(state)
        inertia = np.zeros((simulation.model.nv, simulation.model.nv))
        mujoco.mj_fullM(simulation.model, simulation.data, inertia)
        columns = 6 + np.arange(len(q))
        joints = pin.crba(kinematics.model, kinematics.data, kinematics.q)[
            np.ix_(kinematics.columns, kinematics.columns)
        ]
        hands = [kinematics.position(f"{s}_hand") - simulation.hand_position(s) for s in SIDES]
        worst = max(worst, np.abs(joints - inertia[np.ix_(columns, columns)]).max(), np.abs(hands).max())
    files = f"{simulation.robot.xml_path.name} and {simulation.robot.urdf_path.name}"
    if worst > 1e-6:
        raise ConfigError(f"{files} differ by up to {worst:.2g} in mass, mass matrix or hand position")
    return f"{files} weigh {mass:.2f} kg, and agree to {worst:.1e} on {SAMPLES} random states"


def check_standing(robot: str = DEFAULT_ROBOT) -> str:
    """Check that `qp` stands and squats for two seconds, by 0.1 m or as low as the robot's range goes."""
    from hugwbc.commands import Command, command_ranges
    from hugwbc.gait import Gait
    from hugwbc.robot import load_robot

    low = max(-0.1, command_ranges(Gait.STANDING, load_robot(robot))["h"].finishing[0])
    trace = _played(robot, Command(h=low), 2.0, "standing and squatting")
    if abs(trace.measured[-1, 3] - low) > _SQUATTED:
        raise ConfigError(f"it squats to h = {trace.measured[-1, 3]:.3f} of {low:g} m; {_strain(trace)}; {_REMEDY}")
    return f"the controller qp stands and squats; pelvis at h = {trace.measured[-1, 3]:.3f} m of {low:g} m"


def check_walking(robot: str) -> str:
    """Check that `qp` walks for three seconds, at 0.3 m/s or a third of the robot's fastest, whichever is less."""
    from hugwbc.commands import command_ranges, default_command
    from hugwbc.gait import Gait
    from hugwbc.robot import load_robot

    speed = min(0.3, command_ranges(Gait.WALKING, load_robot(robot))["v_x"].finishing[1] / 3.0)
    command = dataclasses.replace(default_command(Gait.WALKING, load_robot(robot)), v_x=speed)
    trace = _played(robot, command, 3.0, f"walking at {speed:.2f} m/s")
    walked = float(trace.measured[trace.time > 2.0, 0].mean())
    if not 0.5 * speed < walked < 1.5 * speed:
        raise ConfigError(f"it walks at {walked:.2f} of {speed:.2f} m/s; {_strain(trace)}; {_REMEDY}")
    return f"it walks at {walked:.2f} of {speed:.2f} m/s; {_strain(trace)}"


def check_hands(name: str) -> str:
    """Check that `qp` stands while both hands go half the way to the arms' posture `forward`, for a second."""
    from hugwbc.commands import Command
    from hugwbc.kinematics import Kinematics
    from hugwbc.robot import SIDES, load_robot
    from hugwbc.sim import Simulation
    from hugwbc.targets import HandTargets
    from hugwbc.upper_ik.detour import seeds

    robot = load_robot(name)
    kinematics, q, forward = Kinematics(robot), robot.nominal.copy(), list(robot.arm_postures).index("forward")
    q[robot.arms] = (q[robot.arms] + seeds(robot)[:, forward].ravel()) / 2.0
    state = Simulation(robot=robot).reset(q=q)
    kinematics.update(state)
    left, right = (kinematics.position(f"{side}_hand") - state.position for side in SIDES)
    trace = _played(name, Command(), 1.0, "raising both hands", HandTargets.of(left, right))
    error = float(trace.hand_error[-1].max())
    if error > _HAND_ERROR:
        raise ConfigError(
            f"a hand is {100.0 * error:.0f} cm from its target after 1 s; {_strain(trace)}; give arm_servo, or another "
            "forward posture under arm_postures"
        )
    return f"it raises both hands, to {1e3 * error:.0f} mm"


def _played(robot: str, command: "Command", duration: float, what: str, hands: "HandTargets | None" = None) -> "Trace":
    """Return what `qp` does in the arena of `hugwbc play`.

    Raises:
        ConfigError: if the robot falls, or the controller fails.
    """
    from hugwbc.runtime import UpperBodySource, rollout
    from hugwbc.runtime.controllers import ControllerSpec
    from hugwbc.scripts.view import Constant
    from hugwbc.sim.arena import Arena

    simulation = Arena(robot=robot).simulation()
    upper_body = UpperBodySource(simulation.robot) if hands is not None else None
    controller = ControllerSpec("qp", robot=robot).build()
    trace = rollout(controller, Constant(command, hands), simulation, upper_body, duration=duration)
    if trace.fell or trace.safety.failures:
        said = "".join(f"; {message}" for message in trace.safety.messages)
        raise ConfigError(f"the robot fell after {trace.survived_s:.1f} s of {what}; {_strain(trace)}{said}; {_REMEDY}")
    return trace


def _strain(trace: "Trace") -> str:
    """Say which joint came nearest to its speed limit, and which to its torque limit.

    The highest 5 % of the samples and the last 0.2 s before a fall are left out.
    """
    from hugwbc.robot import load_robot

    robot = load_robot(trace.robot)
    before = trace.time <= trace.survived_s - 0.2 * trace.fell
    before |= not before.any()  # it fell at once
    parts = []
    for what, of_all, limits, unit in (
        ("turned at", trace.qvel[before, 6:], robot.velocity_limit, "rad/s"),
        ("gave", trace.torque[before], robot.torque_limit, "N m"),
    ):
        most = np.percentile(np.abs(of_all), 95, axis=0)
        joint = int(np.argmax(most / limits))
        parts.append(f"{robot.joint_names[joint]} {what} {most[joint]:.3g} of {limits[joint]:.3g} {unit}")
    return " and ".join(parts)


def _is_installed(package: str) -> bool:
    try:
        return importlib.util.find_spec(package) is not None
    except (ImportError, ValueError):  # it is kept out on purpose
        return False


def check_policies() -> str:
    """Check that every shipped policy can be read, if policies can be run at all."""
    if not all(map(_is_installed, LEARNED)):
        return WITHOUT_TORCH
    from hugwbc.learned.policy import load_policy, shipped_policies

    names = shipped_policies()
    if not names:
        raise ConfigError("no policy is shipped in models/h1/policies; train one with `hugwbc train`")
    for name in names:
        load_policy(name)
    return f"{', '.join(names)} can be read"


def check_environment() -> str:
    """Check that the training environment gives finite numbers, the same ones for the same seed."""
    if not all(map(_is_installed, LEARNED)):
        return WITHOUT_TORCH
    import torch

    from hugwbc.learned.config import EnvConfig
    from hugwbc.learned.env.humanoid_env import HumanoidEnv

    count, steps = 8, 20
    histories = []
    for _ in range(2):
        env = HumanoidEnv(EnvConfig(count=count), seed=7, threads=1)
        generator = torch.Generator().manual_seed(7)
        for _ in range(steps):
            result = env.step(0.1 * torch.randn(env.actions[0].shape, generator=generator))
            if not bool(torch.isfinite(result.reward).all()):
                raise ConfigError("a reward of the training environment is not finite")
        histories.append(env.observe().critic)
    if not bool(torch.isfinite(histories[0]).all()):
        raise ConfigError("an observation of the training environment is not finite")
    if not torch.equal(*histories):
        raise ConfigError("two runs of the training environment with the same seed differ")
    return f"{count} robots, {steps} steps: finite, and the same twice with one seed"


OF_A_ROBOT: dict[str, Callable[[str], str]] = {
    "table": check_table,
    "models": check_agreement,
    "controller qp": check_standing,
    "walk": check_walking,
    "hands": check_hands,
}
CHECKS: dict[str, Callable[[], str]] = {
    "versions": check_versions,
    "arenas": check_arena,
    "models": check_agreement,
    "controller qp": check_standing,
    "policies": check_policies,
    "training environment": check_environment,
}
