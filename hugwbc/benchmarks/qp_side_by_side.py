"""The whole-body QP against two others on the same states: placo's dynamics solver, and another QP algorithm."""

import dataclasses
import time
import xml.etree.ElementTree as ET

import numpy as np
import placo

from hugwbc import rotations
from hugwbc.evaluation.metrics import percentiles
from hugwbc.mbc.dynamics import Dynamics
from hugwbc.mbc.params import ControllerParams
from hugwbc.mbc.qp import QpStatus, WholeBodyQp
from hugwbc.mbc.tasks import TaskTerms
from hugwbc.robot import SIDES, Robot, load_robot
from hugwbc.state import RobotState

_WEIGHT = 1000.0  # of every row of every task
_REGULARISATION = 1e-7  # of placo's forces and torques
_DAMPING = 30.0  # [1/s]
# Regularisation far below the tasks', so that the optimum is that of the tasks whatever each solver adds to it;
# and limits that do not bind, since each formulation has other ones.
_PARAMS = ControllerParams(
    acceleration_regularisation=1e-7,
    force_regularisation=1e-6,
    torque_fraction=100.0,
    max_normal_force=1e5,
    friction=10.0,
    joint_horizon=0.001,
    qp_tolerance=1e-8,
    qp_max_iterations=200,
)


@dataclasses.dataclass(frozen=True)
class SideBySide:
    """Outcome of the comparison.

    Attributes:
        states: how many.
        solved: by all solvers.
        compared_with_placo: solved ones in which no inequality of the whole-body QP binds, as none does in placo's.
        torque_difference_placo: largest difference of a joint torque to placo's, as a share of the largest torque.
        acceleration_difference_placo: likewise of a generalised acceleration.
        solution_difference_other: largest difference of a component of the solution to the other algorithm's, as a
            share of the largest component of its kind.
        time_ms: p50 and p99 of a solve, in processor time of one thread [ms], by solver; "whole-body QP" (with the
            controller's own tolerance, and with the tight one of the comparison) and "placo" assemble their problem as
            well.
    """

    states: int
    solved: int
    compared_with_placo: int
    torque_difference_placo: float
    acceleration_difference_placo: float
    solution_difference_other: float | None
    time_ms: dict[str, dict[str, float | None]]


def side_by_side(states: int, seed: int = 0, other: str | None = "daqp") -> SideBySide:
    """Solve the inverse dynamics of random states on one foot with each solver.

    One foot stands as a line contact; the other foot, the pelvis (but for its fall to the side), waist and arms have
    random accelerations to follow: as many rows as the robot on one line contact has freedoms, so that the optimum is
    unique and the same in any formulation, as long as no inequality binds. placo, with a line contact that may pull,
    must find the same accelerations and torques; the other algorithm gets the same matrices.

    Args:
        states: how many.
        seed: of the states.
        other: name of a solver of `qpsolvers`; None leaves it out.
    """
    rng, robot, dynamics = np.random.default_rng(seed), load_robot(), Dynamics()
    qp = WholeBodyQp(_PARAMS, robot, dynamics.nv, dynamics.columns)
    product = WholeBodyQp(ControllerParams(), robot, dynamics.nv, dynamics.columns)
    reference = placo_robot(robot)
    times: dict[str, list[float]] = {}
    worst = np.zeros(3)
    solved = compared = 0
    for index in range(states):
        state, stance = random_state(robot, rng), index % 2
        dynamics.update(state)
        asked = _Asked.random(rng)
        contact = np.repeat([stance == 0, stance == 1], 2)
        terms = [_terms(dynamics, stance, asked)]
        begin = time.thread_time()
        product.solve(dynamics, terms, contact)
        _note(times, "whole-body QP", begin)
        begin = time.thread_time()
        solution = qp.solve(dynamics, terms, contact)
        _note(times, "whole-body QP, tight", begin)
        begin = time.thread_time()
        theirs = _solve_with_placo(reference, dynamics, stance, asked)
        _note(times, "placo", begin)
        good = solution.status is QpStatus.SOLVED and theirs.success
        if good and _free(solution.forces[contact]):
            compared += 1
            worst[0] = max(worst[0], _share(theirs.tau[6:] - solution.torque, solution.torque))
            worst[1] = max(worst[1], _share(theirs.qdd - solution.acceleration, solution.acceleration))
        if other is not None:
            begin = time.thread_time()
            x = solve_with_qpsolvers(qp, other)
            _note(times, other, begin)
            good = good and x is not None
            if x is not None:
                worst[2] = max(
                    worst[2],
                    _share(x[: dynamics.nv] - solution.acceleration, solution.acceleration),
                    _share(x[dynamics.nv :] - solution.forces.ravel(), solution.forces),
                )
        solved += good
    return SideBySide(
        states,
        solved,
        compared,
        float(worst[0]),
        float(worst[1]),
        None if other is None else float(worst[2]),
        {name: percentiles(1e3 * np.array(values)) for name, values in times.items()},
    )


def _note(times: dict[str, list[float]], name: str, begin: float) -> None:
    times.setdefault(name, []).append(time.thread_time() - begin)


def _free(forces: np.ndarray) -> bool:
    """Whether forces lie well inside their cones."""
    return bool(np.all(np.abs(forces[:, :2]).max(axis=1) < 0.5 * _PARAMS.friction * forces[:, 2]))


def _share(difference: np.ndarray, of: np.ndarray) -> float:
    return float(np.max(np.abs(difference)) / np.max(np.abs(of)))


def random_state(robot: Robot, rng: np.random.Generator) -> RobotState:
    """Near the nominal pose, heading about along x, moving slowly."""
    return RobotState(
        q=np.clip(robot.nominal + rng.uniform(-0.1, 0.1, 19), robot.lower + 0.05, robot.upper - 0.05),
        dq=rng.uniform(-0.05, 0.05, 19),
        orientation=rotations.from_yaw_pitch_roll(rng.uniform(-0.2, 0.2), *rng.uniform(-0.05, 0.05, 2)),
        angular_velocity=rng.uniform(-0.05, 0.05, 3),
        position=rng.uniform(-1.0, 1.0, 3),
        velocity=rng.uniform(-0.05, 0.05, 3),
    )


@dataclasses.dataclass(frozen=True, eq=False)
class _Asked:
    """Accelerations to follow: of pelvis and swing foot [m/s^2], of waist and arm joints [rad/s^2]."""

    pelvis: np.ndarray
    swing: np.ndarray
    joints: np.ndarray

    @classmethod
    def random(cls, rng: np.random.Generator) -> "_Asked":
        return cls(rng.uniform(-0.3, 0.3, 3), rng.uniform(-1.0, 1.0, 3), rng.uniform(-1.0, 1.0, 9))


def _frames(stance: int, asked: _Asked) -> list[tuple[str, np.ndarray, str, str]]:
    """Frames with a task, the first the standing foot: name, acceleration, axes of its position and orientation."""
    return [
        (f"{SIDES[stance]}_sole", np.zeros(3), "xyz", "yz"),
        (f"{SIDES[1 - stance]}_sole", asked.swing, "xyz", "yz"),
        # Nothing holds the robot sideways on a line: it falls, as it does in every step.
        ("pelvis", asked.pelvis, "xz", "xyz"),
    ]


def _terms(dynamics: Dynamics, stance: int, asked: _Asked) -> TaskTerms:
    """Positions in the world, and orientations about the frames' own axes."""
    jacobian, target = [], []
    for name, acceleration, along, about in _frames(stance, asked):
        frame = dynamics.frame(name)
        rows = ["xyz".index(axis) for axis in along]
        own = frame.rotation.T[["xyz".index(axis) for axis in about]]
        jacobian += [frame.jacobian[rows], own @ frame.jacobian[3:]]
        target.append((acceleration - _DAMPING * frame.velocity[:3] - frame.drift[:3])[rows])
        target.append(own @ (-_DAMPING * frame.velocity[3:] - frame.drift[3:]))
    joints = dynamics.columns[_upper_body(dynamics.robot)]
    jacobian.append(np.eye(dynamics.nv)[joints])
    target.append(asked.joints - _DAMPING * dynamics.v[joints])
    rows = np.concatenate(target)
    return TaskTerms(np.concatenate(jacobian), np.zeros_like(rows), rows, np.full(rows.size, _WEIGHT), rows)


def _upper_body(robot: Robot) -> np.ndarray:
    return np.array([robot.waist, *robot.arms])


def placo_robot(robot: Robot) -> placo.RobotWrapper:
    """The same robot for placo: without shapes, with the same rotor inertia."""
    tree = ET.parse(robot.urdf_path).getroot()
    for link in tree.findall("link"):
        for shape in (*link.findall("visual"), *link.findall("collision")):
            link.remove(shape)
    wrapper = placo.RobotWrapper("h1", placo.Flags.ignore_collisions, ET.tostring(tree, encoding="unicode"))
    armature = np.zeros(wrapper.model.nv)
    armature[[wrapper.get_joint_v_offset(name) for name in robot.joint_names]] = robot.armature
    wrapper.model.armature = armature
    return wrapper


def _solve_with_placo(
    robot: placo.RobotWrapper, dynamics: Dynamics, stance: int, asked: _Asked
) -> placo.DynamicsSolverResult:
    robot.state.q, robot.state.qd = dynamics.q.copy(), dynamics.v.copy()
    robot.update_kinematics()
    solver = placo.DynamicsSolver(robot)
    solver.torque_cost = _REGULARISATION
    for index, (name, acceleration, along, about) in enumerate(_frames(stance, asked)):
        task = solver.add_frame_task(name, robot.get_T_world_frame(name))
        task.configure(name, "soft", _WEIGHT, _WEIGHT)
        task.position().ddtarget_world = acceleration
        task.position().mask.set_axises(along, "task")
        task.orientation().mask.set_axises(about, "local")
        for part in (task.position(), task.orientation()):
            part.kp, part.kd = 0.0, _DAMPING
        if index == 0:
            contact = solver.add_line_contact(task)
            contact.weight_forces = contact.weight_moments = _REGULARISATION
    # A joints task has no acceleration of its own: the velocity target that asks for the same, at this damping.
    joints = solver.add_joints_task()
    table = dynamics.robot
    upper = [table.joint_names[index] for index in _upper_body(table)]
    joints.set_joints({name: robot.get_joint(name) for name in upper})
    joints.set_joints_velocities(dict(zip(upper, (asked.joints / _DAMPING).tolist(), strict=True)))
    joints.configure("upper body", "soft", _WEIGHT)
    joints.kp, joints.kd = 0.0, _DAMPING
    return solver.solve(False)


def solve_with_qpsolvers(qp: WholeBodyQp, solver: str) -> np.ndarray | None:
    """The last problem of a whole-body QP by a solver of `qpsolvers`, shape (nv + 12,); None where it finds none."""
    import qpsolvers

    H, g, A, b, C, low, high, box_low, box_high = qp.problem
    # The algorithms of qpsolvers want no rows without a bound.
    eye = np.eye(g.size)
    lower, upper, above, below = low > -1e19, high < 1e19, box_low > -1e19, box_high < 1e19
    rows = np.vstack((C[upper], -C[lower], eye[below], -eye[above]))
    limits = np.concatenate((high[upper], -low[lower], box_high[below], -box_low[above]))
    return qpsolvers.solve_qp(H, g, rows, limits, A, b, solver=solver)
