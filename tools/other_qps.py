"""Solve one problem with our whole-body QP, with placo's and with TSID's: torques compared, milliseconds of a tick.

    python tools/other_qps.py states FILE.npz    # states of a walk, and what ours and placo's make of them
    python tools/other_qps.py tsid FILE.npz      # the same with TSID, in an environment that needs nothing of hugwbc

All get the same rigid robot, the same wished accelerations of pelvis, swinging foot and joints with the same weights,
and four unilateral points under the soles, which are held by a weight. Rows of ours are made as the controller makes
them, from a model that is updated in the same tick; TSID and placo make theirs in C++.

TSID's wheels for Python 3.11 need Pinocchio 3.4.0, which placo's do not take: `pip install tsid==1.7.1 pin==3.4.0
"cmeel-urdfdom<5" "cmeel-tinyxml2<11"` in an environment of its own.
"""

import argparse
import pathlib
import time
from typing import Any

import numpy as np

STATES, SEED = 200, 7
PELVIS, FOOT, CONTACT, POSTURE = 1.0, 1.0, 1e3, 1e-2  # weights
FORCE, ACCELERATION = 1e-5, 1e-8  # regularisation: of forces, and TSID's default of all variables
FRICTION = 0.7
HIGHEST = 2000.0  # [N], of a point
POINTS = ("left_heel", "left_toe", "right_heel", "right_toe")
SOLES = ("left_sole", "right_sole")


def states(path: pathlib.Path) -> None:
    """Record states of a walk with the QP, and solve them with ours and with placo's."""
    from hugwbc.commands import Command
    from hugwbc.gait import Gait
    from hugwbc.mbc.dynamics import Dynamics
    from hugwbc.runtime.loop import ControlLoop
    from hugwbc.sim import Simulation

    simulation = Simulation(seed=SEED)
    loop = ControlLoop("qp", Command(gait=Gait.WALKING, v_x=0.5), simulation)
    loop.reset()
    robot, rng = simulation.robot, np.random.default_rng(SEED)
    dynamics, records = Dynamics(robot), []
    while len(records) < STATES:
        loop.step(loop.decide(simulation.time), loop.period)
        state = simulation.state()
        assert state.foot_force is not None
        stands = state.foot_force[:, 2] > 20.0
        if simulation.time > 1.0 and stands.any() and len(records) < simulation.time * 50.0 - 50.0:
            dynamics.update(state)
            wished = rng.normal(0.0, 1.0, 6 + 3 + robot.kp.size)
            records.append((state, dynamics.q.copy(), dynamics.v.copy(), np.repeat(stands, 2), wished))
    found = {"ours": ours(robot, records), "placo": placo_s(robot, records)}
    limits = robot.torque_limit[np.argsort(dynamics.columns)]
    model = {"urdf": str(robot.urdf_path), "armature": dynamics.model.armature, "limits": limits}
    recorded = {name: np.array([record[i] for record in records]) for i, name in ((1, "q"), (2, "v"), (3, "contact"))}
    recorded["wished"] = np.array([record[4] for record in records])
    solved = {f"{who}_tau": torques for who, (torques, _) in found.items()}
    solved |= {f"{who}_s": times for who, (_, times) in found.items()}
    save(path, {**model, **recorded, **solved})
    tell(path)


def ours(robot, records) -> tuple[np.ndarray, np.ndarray]:  # noqa: ANN001
    """Return our torques in the order of the velocities, shape (states, n), and the time of each tick [s]."""
    import dataclasses

    from hugwbc.mbc.dynamics import Dynamics
    from hugwbc.mbc.params import ControllerParams
    from hugwbc.mbc.qp import QpStatus, WholeBodyQp
    from hugwbc.mbc.tasks import TaskTerms

    dynamics = Dynamics(robot)
    dynamics._damping[:] = 0.0  # the others have none
    params = dataclasses.replace(
        ControllerParams(),
        friction=FRICTION,
        max_normal_force=HIGHEST,
        torque_fraction=1.0,
        force_regularisation=FORCE,
        acceleration_regularisation=ACCELERATION,
    )
    qp = WholeBodyQp(params, robot, dynamics.nv, dynamics.columns)
    qp._fill_joint_limits = lambda dynamics: None  # type: ignore[method-assign]  # nor bounds on acceleration
    posture = np.eye(dynamics.nv)[6:]
    torques, times = [], []
    for state, _, _, contact, wished in records:
        begin = time.perf_counter()
        dynamics.update(state)
        pelvis, terms = dynamics.frame("pelvis"), []
        terms.append(_terms(TaskTerms, pelvis.jacobian, pelvis.drift, wished[:6], PELVIS))
        for sole, stands in zip(SOLES, contact[::2], strict=True):
            if not stands:
                foot = dynamics.frame(sole)
                terms.append(_terms(TaskTerms, foot.jacobian[:3], foot.drift[:3], wished[6:9], FOOT))
        for name, stands in zip(POINTS, contact, strict=True):
            if stands:
                point = dynamics.frame(name)
                terms.append(_terms(TaskTerms, point.jacobian[:3], point.drift[:3], np.zeros(3), CONTACT))
        terms.append(_terms(TaskTerms, posture, np.zeros(len(posture)), wished[9:], POSTURE))
        solution = qp.solve(dynamics, terms, contact)
        times.append(time.perf_counter() - begin)
        if solution.status is not QpStatus.SOLVED:
            raise SystemExit(f"ours: {solution.status.value}")
        ordered = np.empty(len(posture))
        ordered[dynamics.columns - 6] = solution.torque
        torques.append(ordered)
    return np.array(torques), np.array(times)


def _terms(kind, jacobian, drift, acceleration, weight):  # noqa: ANN001, ANN202
    return kind(jacobian, drift, acceleration, np.full(len(drift), weight))


def placo_s(robot, records) -> tuple[np.ndarray, np.ndarray]:  # noqa: ANN001
    """Return placo's torques and times, likewise."""
    import placo

    wrapper = placo.RobotWrapper(str(robot.urdf_path), placo.Flags.ignore_collisions)
    for name, inertia, limit in zip(robot.joint_names, robot.armature, robot.torque_limit, strict=True):
        wrapper.set_rotor_inertia(name, float(inertia))
        wrapper.set_gear_ratio(name, 1.0)
        wrapper.set_torque_limit(name, float(limit))
    names = list(wrapper.joint_names())
    solvers = {}
    for pattern in ((True, True), (True, False), (False, True)):
        solver = placo.DynamicsSolver(wrapper)
        solver.enable_torque_limits(True)
        solver.torque_cost = 0.0
        place = solver.add_position_task("pelvis", np.zeros(3))
        turn = solver.add_orientation_task("pelvis", np.eye(3))
        joints = solver.add_joints_task()
        place.configure("place", "soft", PELVIS)
        turn.configure("turn", "soft", PELVIS)
        joints.configure("joints", "soft", POSTURE)
        place.kp = place.kd = turn.kp = turn.kd = joints.kp = 0.0
        joints.kd = 1.0
        joints.set_joints(dict.fromkeys(names, 0.0))  # without stiffness, any
        swing = []
        for foot, stands in enumerate(pattern):
            if stands:
                for name in POINTS[2 * foot : 2 * foot + 2]:
                    task = solver.add_position_task(name, np.zeros(3))
                    task.configure(name, "soft", CONTACT)
                    task.kp = task.kd = 0.0
                    contact = solver.add_unilateral_point_contact(task)
                    contact.mu, contact.weight_forces = FRICTION / np.sqrt(2.0), FORCE
            else:
                task = solver.add_position_task(SOLES[foot], np.zeros(3))
                task.configure(SOLES[foot], "soft", FOOT)
                task.kp = task.kd = 0.0
                swing.append(task)
        solvers[pattern] = (solver, place, turn, joints, swing)
    torques, times = [], []
    for _, q, v, contact, wished in records:
        begin = time.perf_counter()
        solver, place, turn, joints, swing = solvers[tuple(contact[::2].tolist())]
        wrapper.state.q, wrapper.state.qd = q, v
        wrapper.update_kinematics()
        place.ddtarget_world, turn.domega_world = wished[:3], wished[3:6]
        for task in swing:
            task.ddtarget_world = wished[6:9]
        speeds = v[6:] + wished[9:]
        joints.set_joints_velocities(dict(zip(names, speeds.tolist(), strict=True)))
        result = solver.solve(False)
        times.append(time.perf_counter() - begin)
        if not result.success:
            raise SystemExit("placo's solver failed")
        torques.append(np.array(result.tau)[6:])
    return np.array(torques), np.array(times)


def tsid_s(path: pathlib.Path) -> None:
    """Solve the recorded states with TSID, and compare."""
    import pinocchio as pin
    import tsid.tsid_pywrap as tsid  # pyright: ignore[reportMissingImports]

    data = dict(np.load(path))
    model = pin.buildModelFromUrdf(str(data["urdf"]), pin.JointModelFreeFlyer())
    model.armature[:] = data["armature"]
    robot = tsid.RobotWrapper(model, tsid.RootJointType.FLOATING_BASE_SYSTEM, False)
    normal = np.array([0.0, 0.0, 1.0])
    problems = {}
    for pattern in ((True, True), (True, False), (False, True)):
        formulation = tsid.InverseDynamicsFormulationAccForce("tsid", robot, False)
        formulation.computeProblemData(0.0, data["q"][0], data["v"][0])
        pelvis = _frame_task(tsid, robot, "pelvis", 6)
        formulation.addMotionTask(pelvis, PELVIS, 1, 0.0)
        posture = tsid.TaskJointPosture("posture", robot)
        posture.setKp(np.zeros(robot.na))
        posture.setKd(np.zeros(robot.na))
        formulation.addMotionTask(posture, POSTURE, 1, 0.0)
        swing, contacts = [], []
        for foot, stands in enumerate(pattern):
            if stands:
                for name in POINTS[2 * foot : 2 * foot + 2]:
                    contact = tsid.ContactPoint(name, robot, name, normal, FRICTION / np.sqrt(2.0), 0.0, HIGHEST)
                    contact.setKp(np.zeros(3))
                    contact.setKd(np.zeros(3))
                    contact.useLocalFrame(False)
                    contact.setRegularizationTaskWeightVector(np.ones(3))
                    formulation.addRigidContact(contact, FORCE, CONTACT, True)
                    contacts.append(contact)
            else:
                task = _frame_task(tsid, robot, SOLES[foot], 3)
                formulation.addMotionTask(task, FOOT, 1, 0.0)
                swing.append(task)
        bounds = tsid.TaskActuationBounds("bounds", robot)
        bounds.setBounds(-data["limits"], data["limits"])
        formulation.addActuationTask(bounds, 1.0, 0, 0.0)
        solver = tsid.SolverHQuadProgFast("solver")
        solver.resize(formulation.nVar, formulation.nEq, formulation.nIn)
        problems[pattern] = (formulation, solver, pelvis, posture, swing, bounds, contacts)
    torques, times = [], []
    pose, joints = tsid.TrajectorySample(12, 6), tsid.TrajectorySample(robot.na)
    at_origin = np.concatenate((np.zeros(3), np.eye(3).ravel()))
    for q, v, contact, wished in zip(data["q"], data["v"], data["contact"], data["wished"], strict=True):
        begin = time.perf_counter()
        formulation, solver, pelvis, posture, swing, *_ = problems[tuple(contact[::2].tolist())]
        for task, acceleration in (
            (pelvis, wished[:6]),
            *((task, np.append(wished[6:9], np.zeros(3))) for task in swing),
        ):
            pose.value(at_origin)
            pose.derivative(np.zeros(6))
            pose.second_derivative(acceleration)
            task.setReference(pose)
        joints.value(np.zeros(robot.na))
        joints.derivative(np.zeros(robot.na))
        joints.second_derivative(wished[9:])
        posture.setReference(joints)
        problem = formulation.computeProblemData(0.0, q, v)
        solution = solver.solve(problem)
        torque = formulation.getActuatorForces(solution)
        times.append(time.perf_counter() - begin)
        torques.append(np.array(torque).ravel())
    save(path, {**data, "tsid_tau": np.array(torques), "tsid_s": np.array(times)})
    tell(path)


def _frame_task(tsid, robot, frame: str, rows: int):  # noqa: ANN001, ANN202
    task = tsid.TaskSE3Equality(frame, robot, frame)
    task.setKp(np.zeros(6))
    task.setKd(np.zeros(6))
    task.useLocalFrame(False)
    task.setMask(np.array([1.0] * rows + [0.0] * (6 - rows)))
    return task


def save(path: pathlib.Path, arrays: dict[str, Any]) -> None:
    """Write arrays by name."""
    with path.open("wb") as file:
        np.savez(file, allow_pickle=False, **arrays)


def tell(path: pathlib.Path) -> None:
    """Print the median time of each, and how far its torques are from ours."""
    data = dict(np.load(path))
    for name in ("ours", "placo", "tsid"):
        if f"{name}_tau" in data:
            times, away = 1e3 * data[f"{name}_s"][20:], np.abs(data[f"{name}_tau"] - data["ours_tau"]).max(1)
            print(
                f"{name:6} {np.median(times):.3f} ms (90 %: {np.percentile(times, 90):.3f}); largest difference of a "
                f"torque to ours: median {np.median(away):.4f}, 90 % {np.percentile(away, 90):.4f}, "
                f"most {away.max():.4f} N m"
            )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("verb", choices=("states", "tsid"))
    parser.add_argument("file", type=pathlib.Path)
    given = parser.parse_args()
    {"states": states, "tsid": tsid_s}[given.verb](given.file)
