"""What objects cost, and how firmly two hands hold a box with given contacts.

python -m hugwbc.benchmarks.scene_physics            # time of a physics step and of a tick, with and without objects
python -m hugwbc.benchmarks.scene_physics --grasp    # the table of contacts in docs/scenes.md
"""

import argparse
import dataclasses
import time
from typing import Any

import mujoco
import numpy as np

from hugwbc.commands import Command
from hugwbc.controller import JointCommand
from hugwbc.mbc import WholeBodyController
from hugwbc.robot import SIDES, load_robot
from hugwbc.runtime.loop import ControlLoop
from hugwbc.scripts.command_source import Constant
from hugwbc.sim import Scene, Simulation, load_scene
from hugwbc.sim.scenes import Box, Table

REPETITIONS, STEPS, TICKS = 7, 150, 60
GRASP_TIME, SETTLING = 1.0, 0.2  # [s]
# A stiff sling at the pelvis holds the robot, so that a grasp is that of the arms alone [N/m, N*s/m, N*m, N*m*s].
_SPRING, _DAMPER, _TURN_SPRING, _TURN_DAMPER = 4e4, 4e3, 4e3, 4e2
_CONTACTS: tuple[dict[str, Any], ...] = (
    {},
    {"iterations": 8},
    {"time_constant": 0.005, "impedance": (0.9, 0.95)},
    {"time_constant": 0.005, "impedance": (0.99, 0.995)},
    {"time_constant": 0.0075, "impedance": (0.99, 0.995)},
    {"time_constant": 0.01, "impedance": (0.99, 0.995)},
    {"time_constant": 0.015, "impedance": (0.99, 0.995)},
)


def nine_boxes() -> Scene:
    """Return a table with nine boxes that lie still."""
    boxes = [Box(name=f"box-{i}", on="desk", position=(0.0, 0.2 * (i - 4)), size=(0.15,) * 3) for i in range(9)]
    return Scene((Table(name="desk", position=(1.5, 0.0), size=(1.0, 2.0)), *boxes))


def step_times() -> dict[str, tuple[float, float, float]]:
    """Return the median and the least time of a physics step [us] and the median of a tick of the QP [ms].

    The runs are interleaved, and processor time is measured, so that other programs disturb all of them alike.
    """
    worlds = {
        "no scene": Simulation(),
        "workshop": Simulation(scene=load_scene("workshop")),
        "nine boxes on a table": Simulation(scene=nine_boxes()),
        "the same, without sleep": Simulation(scene=nine_boxes()),
    }
    worlds["the same, without sleep"].model.opt.enableflags = 0
    hold = JointCommand.position(load_robot(), load_robot().nominal)
    steps: dict[str, list[float]] = {name: [] for name in worlds}
    ticks: dict[str, list[float]] = {name: [] for name in worlds}
    loops = {name: ControlLoop(WholeBodyController(), Constant(Command()), world) for name, world in worlds.items()}
    for _ in range(REPETITIONS):
        for name, world in worlds.items():
            world.reset()
            world.step(hold, 0.1)
            begin = time.process_time()
            world.step(hold, STEPS * world.timestep)
            steps[name].append(1e6 * (time.process_time() - begin) / STEPS)
            loop = loops[name]
            loop.reset()
            for tick in range(TICKS):
                begin = time.process_time()
                command = loop.decide(tick * loop.period)
                ticks[name].append(1e3 * (time.process_time() - begin))
                loop.step(command, loop.period)
    return {name: (float(np.median(steps[name])), min(steps[name]), float(np.median(ticks[name]))) for name in worlds}


@dataclasses.dataclass(frozen=True)
class Grasp:
    """How two hands held a box.

    Attributes:
        unrest: standard deviation of the left hand's force along y, after `SETTLING` [N].
        slip: way of the box in the hands, after `SETTLING` [m].
        depth: greatest depth of a hand in the box [m].
    """

    unrest: float
    slip: float
    depth: float


def grasp(
    mass: float,
    force: float,
    *,
    time_constant: float | None = None,
    impedance: tuple[float, float] | None = None,
    iterations: int | None = None,
) -> Grasp:
    """Hold a box between both hands for `GRASP_TIME`.

    Args:
        mass: of the box [kg].
        force: with which each hand presses [N].
        time_constant: of the box's contacts [s]; None for those of a scene.
        impedance: of the box's contacts, smallest and largest; None for those of a scene.
        iterations: of the solver; None for those of a scene.
    """
    start = Simulation()
    left, right = start.hand_position("left"), start.hand_position("right")
    size = (0.1, float(left[1] - right[1]) - 0.0605, 0.1)  # the forearms are 6 cm thick
    at = (float(left[0]), 0.0, float(left[2]) - 0.05)
    simulation = Simulation(scene=Scene((Box(name="box", position=at, size=size, mass=mass),)))
    model, data = simulation.model, simulation.data
    body = model.body("box").id
    if time_constant is not None:
        model.geom_solref[model.geom_bodyid == body, 0] = time_constant
    if impedance is not None:
        model.geom_solimp[model.geom_bodyid == body, :2] = impedance
    if iterations is not None:
        model.opt.iterations = iterations
    command, place = _squeeze(simulation, force, mass * 9.81), simulation.qpos[:3]
    forces, ways, depth = [], [], 0.0
    for _ in range(round(GRASP_TIME / simulation.timestep)):
        _hang(simulation, place)
        simulation.step(command, simulation.timestep)
        state = simulation.objects["box"]
        assert state.hand_force is not None
        forces.append(state.hand_force[0, 1])
        ways.append(state.position - simulation.hand_position("left"))
        touching = np.any(model.geom_bodyid[data.contact.geom] == body, axis=1)
        depth = max(depth, float(-data.contact.dist[touching].min(initial=0.0)))
    settled = round(SETTLING / simulation.timestep)
    return Grasp(float(np.std(forces[settled:])), float(np.linalg.norm(ways[-1] - ways[settled])), depth)


def _squeeze(simulation: Simulation, force: float, weight: float) -> JointCommand:
    """Return a command that holds the joints, presses both hands inwards and carries a weight [N]."""
    robot, jacobian = simulation.robot, np.zeros((3, simulation.model.nv))
    torque = np.zeros(simulation.model.nv)
    for side, sign in zip(SIDES, (-1.0, 1.0), strict=True):
        site = simulation.model.site(f"{side}_hand").id
        mujoco.mj_jacSite(simulation.model, simulation.data, jacobian, None, site)
        torque += jacobian.T @ [0.0, sign * force, 0.5 * weight]
    joints = [int(simulation.model.joint(name).dofadr[0]) for name in robot.joint_names]
    return dataclasses.replace(JointCommand.position(robot, robot.nominal), tau=torque[joints])


def _hang(simulation: Simulation, place: np.ndarray) -> None:
    qpos, qvel, sling = simulation.qpos, simulation.qvel, simulation.data.qfrc_applied
    sling[:3] = _SPRING * (place - qpos[:3]) - _DAMPER * qvel[:3] + [0.0, 0.0, simulation.robot.mass * 9.81]
    sling[3:6] = -_TURN_SPRING * qpos[4:7] - _TURN_DAMPER * qvel[3:6]


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--grasp", action="store_true", help="how firmly two hands hold a box")
    if not parser.parse_args().grasp:
        print("| | step [us], median and least | QP tick [ms] |\n|---|---|---|")
        for name, (median, least, tick) in step_times().items():
            print(f"| {name} | {median:.0f}, {least:.0f} | {tick:.2f} |", flush=True)
        return
    print("| box, force | contacts | unrest [N] | slip [mm] | depth [mm] |\n|---|---|---|---|---|")
    for mass, force in ((1.0, 40.0), (3.0, 40.0), (3.0, 60.0)):
        for changes in _CONTACTS:
            held = grasp(mass, force, **changes)
            name = ", ".join(f"{key} {value}" for key, value in changes.items()) or "as in a scene"
            figures = f"{held.unrest:.1f} | {1e3 * held.slip:.1f} | {1e3 * held.depth:.2f}"
            print(f"| {mass:g} kg, {force:g} N | {name} | {figures} |", flush=True)


if __name__ == "__main__":
    main()
