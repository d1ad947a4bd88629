"""Compare our hand IK with mink's and pink's on the same targets: time, residual, limit violations, jitter.

As they are set up here, mink and pink have neither self-collision avoidance nor acceleration limits and approach their
targets at the joints' speed limit; our hands move at 1.5 m/s at most. Every target has 3 s.

mink and pink are development extras; a solver that is not installed is left out.
"""

import dataclasses
import importlib.util
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from hugwbc.evaluation import metrics
from hugwbc.kinematics import pinocchio_model
from hugwbc.robot import SIDES, load_robot
from hugwbc.state import RobotState
from hugwbc.targets import HandTargets
from hugwbc.upper_ik import ArmIK, ArmIKConfig
from hugwbc.upper_ik.workspace import arm_length, arm_reach

DT = 0.02  # [s]
TICKS = 150  # of each target
FARTHEST = 1.0  # [m], distance of a target out of reach from the shoulder
POSTURE_COST = 1e-3
LM_DAMPING = 1e-3
TOLERANCE = 1e-6

Step = Callable[[np.ndarray], np.ndarray]


@dataclasses.dataclass(frozen=True)
class IKFigures:
    """Figures of one solver.

    Attributes:
        tick_ms: p50 and p99 of the processor time for a tick of both arms [ms].
        residual_m: mean distance of a hand to a reachable target after `TICKS` ticks [m].
        reached: share of the reachable targets that a hand is within 1 cm of by then.
        excess_m: mean distance of a hand to a target out of reach, minus the distance that the arm's length leaves [m].
        limit_violations: number of ticks with a joint position or velocity beyond its limit.
        jitter: mean squared joint jerk [rad^2/s^6].
        exceptions: number of ticks in which the solver raised; the arms then do not move.
    """

    tick_ms: dict[str, float | None]
    residual_m: float
    reached: float
    excess_m: float
    limit_violations: int
    jitter: float
    exceptions: int


def sample_targets(count: int, seed: int) -> np.ndarray:
    """Return pairs of hand targets in the pelvis frame [m], alternately reachable and out of reach.

    Reachable targets are the hands' positions in random postures without self-collision. The others lie around the
    shoulder, farther away than the arm is long.

    Args:
        count: number of pairs.
        seed: seed of the targets.

    Returns:
        Targets of the left and the right hand, shape (count, 2, 3).
    """
    rng = np.random.default_rng(seed)
    ik = ArmIK()
    robot = ik.robot
    mirror = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, 1.0]])
    pairs = []
    for index in range(count):
        if index % 2:
            direction = rng.normal(size=(2, 3))
            direction /= np.linalg.norm(direction, axis=1, keepdims=True)
            distance = rng.uniform(arm_reach(robot), FARTHEST, (2, 1))
            pairs.append(robot.shoulder * mirror + distance * direction)
            continue
        q = rng.uniform(ik.lower, ik.upper)
        while ik.clearance(q).min() < 0.02:
            q = rng.uniform(ik.lower, ik.upper)
        pairs.append(ik.hands(q, 0.0).copy())
    return np.array(pairs)


def compare_solvers(count: int, on_progress: Callable[[float], None] | None = None) -> dict[str, IKFigures]:
    """Visit the same targets with every solver that is installed and return its figures by name.

    Args:
        count: number of targets, at least 2.
        on_progress: called with the fraction done.
    """
    targets = sample_targets(count, 0)
    makers: dict[str, Callable[[], Step]] = {"hugwbc": _ours, "hugwbc through the body": _ours_through_the_body}
    makers |= {name: make for name, make in (("mink", _mink), ("pink", _pink)) if importlib.util.find_spec(name)}
    figures = {}
    for number, (name, make) in enumerate(makers.items()):
        figures[name] = _measure(make(), targets)
        if on_progress is not None:
            on_progress((number + 1) / len(makers))
    return figures


def _measure(step: Step, targets: np.ndarray) -> IKFigures:
    robot, probe = load_robot(), ArmIK()
    arms = robot.arms
    lower, upper = robot.lower[arms], robot.upper[arms]
    speed = robot.velocity_limit[arms] * ArmIKConfig().speed_fraction
    q = robot.nominal[arms].copy()
    path, times, final, exceptions, violations = [q], [], [], 0, 0
    for pair in targets:
        for _ in range(TICKS):
            begin = time.thread_time()
            try:
                new = step(pair)
            except Exception:  # other packages may raise anything; it counts as a failure of the tick
                exceptions += 1
                new = path[-1]
            times.append(1e3 * (time.thread_time() - begin))
            outside = np.any((new < lower - TOLERANCE) | (new > upper + TOLERANCE))
            violations += bool(outside or np.any(np.abs(new - path[-1]) > speed * DT + TOLERANCE))
            path.append(new)
        final.append(np.linalg.norm(probe.hands(path[-1], 0.0) - pair, axis=1))
    residual = np.array(final)
    away = np.linalg.norm(targets - robot.shoulder * np.array([[1.0, 1.0, 1.0], [1.0, -1.0, 1.0]]), axis=2)
    return IKFigures(
        tick_ms=metrics.percentiles(np.array(times)),
        residual_m=float(residual[::2].mean()),
        reached=float(np.mean(residual[::2] < 0.01)),
        excess_m=float(np.mean(residual[1::2] - (away[1::2] - arm_length(robot)))),
        limit_violations=violations,
        jitter=metrics.jitter(np.array(path), DT),
        exceptions=exceptions,
    )


def _ours_through_the_body() -> Step:
    """Return our solver without self-collision avoidance, for a comparison on equal terms."""
    return _ours(ArmIKConfig(collision_weight=1e-12, touch_speed=ArmIKConfig().hand_speed))


def _ours(config: ArmIKConfig | None = None) -> Step:
    robot, ik = load_robot(), ArmIK(config)
    state = RobotState(robot.nominal, np.zeros(19), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3))
    return lambda pair: ik.solve(HandTargets(pair[0], pair[1]), state, DT).q


def _pink() -> Step:
    """Return pink's solver on a model of the arms: frame tasks on both hands, a weak posture task, pink's limits."""
    import pink
    import pinocchio as pin

    robot = load_robot()
    whole = pinocchio_model()
    locked = [whole.getJointId(name) for name in whole.names[1:] if name not in robot.arm_names]
    model = pin.buildReducedModel(whole, locked, pin.neutral(whole))
    order = np.array([model.joints[model.getJointId(name)].idx_q for name in robot.arm_names])
    model.velocityLimit[order] = robot.velocity_limit[robot.arms] * ArmIKConfig().speed_fraction
    configuration = pink.Configuration(model, model.createData(), pin.neutral(model))
    hands = [
        pink.FrameTask(f"{side}_hand", position_cost=1.0, orientation_cost=0.0, lm_damping=LM_DAMPING) for side in SIDES
    ]
    posture = pink.PostureTask(cost=POSTURE_COST)
    posture.set_target(configuration.q)

    def step(pair: np.ndarray) -> np.ndarray:
        for task, point in zip(hands, pair, strict=True):
            task.set_target(pin.SE3(np.eye(3), point))
        velocity = pink.solve_ik(configuration, [*hands, posture], DT, solver="daqp")
        configuration.integrate_inplace(velocity, DT)
        return configuration.q[order].copy()

    return step


def _mink() -> Step:
    """Return mink's solver on a model of the arms: frame tasks on both hands, a weak posture task, mink's limits."""
    import mink
    import mujoco

    robot = load_robot()
    spec = mujoco.MjSpec.from_file(str(robot.xml_path))
    keep = set(robot.arm_names)
    for element in (*spec.keys, *spec.sensors, *spec.actuators, *spec.pairs):
        spec.delete(element)
    for joint in list(spec.joints):
        if joint.name not in keep:
            spec.delete(joint)
    spec.body("pelvis").pos = [0.0, 0.0, 0.0]
    model = spec.compile()
    order = np.array([model.jnt_qposadr[model.joint(name).id] for name in robot.arm_names])
    configuration: Any = mink.Configuration(model)
    configuration.update(np.zeros(model.nq))
    hands = [
        mink.FrameTask(f"{side}_hand", "site", position_cost=1.0, orientation_cost=0.0, lm_damping=LM_DAMPING)
        for side in SIDES
    ]
    posture = mink.PostureTask(model, cost=POSTURE_COST)
    posture.set_target(configuration.q)
    speeds = robot.velocity_limit[robot.arms] * ArmIKConfig().speed_fraction
    limits = [
        mink.ConfigurationLimit(model),
        mink.VelocityLimit(model, dict(zip(robot.arm_names, speeds.tolist(), strict=True))),
    ]

    def step(pair: np.ndarray) -> np.ndarray:
        for task, point in zip(hands, pair, strict=True):
            task.set_target(mink.SE3.from_translation(point))
        velocity = mink.solve_ik(configuration, [*hands, posture], DT, "daqp", limits=limits)
        configuration.integrate_inplace(velocity, DT)
        return configuration.q[order].copy()

    return step
