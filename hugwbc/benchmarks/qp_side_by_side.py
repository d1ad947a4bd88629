"""Compare the whole-body QP with placo's dynamics solver and another QP algorithm on the same states."""

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

_WEIGHT = 1000.0  # weight of every row of every task
_REGULARISATION = 1e-7  # weight of placo's forces and torques
_DAMPING = 30.0  # [1/s], velocity gain of every task
# The regularisation is far below the tasks' weight, so that what a solver adds to the tasks hardly moves the optimum.
# The limits are wide enough not to bind, since the formulations differ in them.
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
        states: number of states.
        solved: number of states that all solvers solved.
        compared_with_placo: number of solved states in which no inequality of the whole-body QP binds; placo's problem
            here has none.
        torque_difference_placo: largest difference of a joint torque to placo's, as a share of the largest torque.
        acceleration_difference_placo: the same for the generalised accelerations.
        solution_difference_other: largest difference of a component of the solution to the other algorithm's, as a
            share of the largest component of its kind; None without another algorithm.
        time_ms: p50 and p99 of the processor time of one solve on one thread [ms], by solver. "whole-body QP" (with the
            controller's tolerance, and with the tight one of the comparison) and "placo" include the assembly of the
            problem.
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

    One foot stands on a line contact. The other foot, the pelvis (except for its fall to the side), waist and arms
    follow random accelerations. The tasks have as many rows as the robot on one line contact has degrees of freedom, so
    that the optimum is unique and the same in any formulation as long as no inequality binds. placo, with a line
    contact that may pull, must find the same accelerations and torques; the other algorithm gets the same matrices.

    Args:
        states: number of states.
        seed: seed of the states.
        other: name of a solver of `qpsolvers`; None for no other algorithm.
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
    """Return whether the contact forces lie well inside their friction cones."""
    return bool(np.all(np.abs(forces[:, :2]).max(axis=1) < 0.5 * _PARAMS.friction * forces[:, 2]))


def _share(difference: np.ndarray, of: np.ndarray) -> float:
    return float(np.max(np.abs(difference)) / np.max(np.abs(of)))


def random_state(robot: Robot, rng: np.random.Generator) -> RobotState:
    """Return a slow state near the nominal pose with a heading near x."""
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
    """Desired accelerations of pelvis and swing foot [m/s^2], and of waist and arm joints [rad/s^2]."""

    pelvis: np.ndarray
    swing: np.ndarray
    joints: np.ndarray

    @classmethod
    def random(cls, rng: np.random.Generator) -> "_Asked":
        return cls(rng.uniform(-0.3, 0.3, 3), rng.uniform(-1.0, 1.0, 3), rng.uniform(-1.0, 1.0, 9))


def _frames(stance: int, asked: _Asked) -> list[tuple[str, np.ndarray, str, str]]:
    """Return name, acceleration, position axes and orientation axes of the frames with a task, stance foot first."""
    return [
        (f"{SIDES[stance]}_sole", np.zeros(3), "xyz", "yz"),
        (f"{SIDES[1 - stance]}_sole", asked.swing, "xyz", "yz"),
        # A line contact exerts no moment about its line: sideways the robot falls, as in every step of a walk.
        ("pelvis", asked.pelvis, "xz", "xyz"),
    ]


def _terms(dynamics: Dynamics, stance: int, asked: _Asked) -> TaskTerms:
    """Return the rows of all tasks: positions in the world, orientations about the frames' own axes."""
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
    """Return the robot for placo, without geometry and with the same rotor inertia."""
    tree = ET.parse(robot.urdf_path).getroot()
    for link in tree.findall("link"):
        for shape in (*link.findall("visual"), *link.findall("collision")):
            link.remove(shape)
    wrapper = placo.RobotWrapper("h1", placo.Flags.ignore_collisions, ET.tostring(tree, encoding="unicode"))
    armature = np.zeros(wrapper.model.nv)
    armature[6:] = robot.armature
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
    # placo's joints task takes no acceleration. With a damping d, the velocity target a / d asks for acceleration a.
    joints = solver.add_joints_task()
    table = dynamics.robot
    upper = [table.joint_names[index] for index in _upper_body(table)]
    joints.set_joints({name: robot.get_joint(name) for name in upper})
    joints.set_joints_velocities(dict(zip(upper, (asked.joints / _DAMPING).tolist(), strict=True)))
    joints.configure("upper body", "soft", _WEIGHT)
    joints.kp, joints.kd = 0.0, _DAMPING
    return solver.solve(False)


def solve_with_qpsolvers(qp: WholeBodyQp, solver: str) -> np.ndarray | None:
    """Solve the last problem of a whole-body QP with a solver of `qpsolvers`.

    Args:
        qp: QP that has been solved once.
        solver: name of the solver.

    Returns:
        Accelerations and forces, shape (nv + 12,); None if the solver finds no solution.
    """
    import qpsolvers

    H, g, A, b, C, low, high, box_low, box_high = qp.problem
    # The solvers of qpsolvers expect every row to have a finite bound.
    eye = np.eye(g.size)
    lower, upper, above, below = low > -1e19, high < 1e19, box_low > -1e19, box_high < 1e19
    rows = np.vstack((C[upper], -C[lower], eye[below], -eye[above]))
    limits = np.concatenate((high[upper], -low[lower], box_high[below], -box_low[above]))
    return qpsolvers.solve_qp(H, g, rows, limits, A, b, solver=solver)
