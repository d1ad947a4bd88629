"""How firm the ground is with given physics: sink, slip, energy drift, and the time that a physics step takes.

python -m hugwbc.benchmarks.ground            # the tables of docs/arena.md, in some ten minutes
python -m hugwbc.benchmarks.ground --batch    # step time of 1,024 robots with the former and today's physics
"""

import argparse
import dataclasses
import time
from collections.abc import Iterator, Sequence

import mujoco
import numpy as np

from hugwbc.commands import Command
from hugwbc.controller import Controller, JointCommand, UpperBody
from hugwbc.gait import Gait
from hugwbc.mbc import WholeBodyController
from hugwbc.robot import SIDES, Robot, load_robot
from hugwbc.runtime.safety import SafetyFilter
from hugwbc.sim import Actuators, Ground, Simulation
from hugwbc.sim.batch import BatchSimulation
from hugwbc.sim.scene import SIMULATION_TIMESTEP, TRAINING_TIMESTEP

SPEEDS = (0.5, 1.0)  # [m/s]
WALK_TIME, STAND_TIME, LOAD_TIME, FLIGHT_TIME = 6.0, 2.0, 2.0, 0.6  # [s]
LOAD = 40.0  # [N], sideways at the pelvis
_SETTLING = 1.0  # [s], at the start of a stand
FIRM_GROUND, FORMER_GROUND = Ground.named("firm"), Ground.named("soft")
"""The grounds of arenas 2 and 1 (docs/arena.md)."""


@dataclasses.dataclass(frozen=True)
class Physics:
    """A time step, a ground, and the robot on it.

    Attributes:
        timestep: physics time step [s].
        ground: firmness of the ground.
        robot: name of the robot.
        actuators: drives of its joints.
    """

    timestep: float = SIMULATION_TIMESTEP
    ground: Ground = dataclasses.field(default_factory=lambda: FIRM_GROUND)
    robot: str = "h1"
    actuators: Actuators = dataclasses.field(default_factory=Actuators.ideal)

    def simulation(self) -> Simulation:
        """Build a simulation with this physics."""
        robot = load_robot(self.robot)
        return Simulation(timestep=self.timestep, robot=robot, actuators=self.actuators, ground=self.ground)


@dataclasses.dataclass(frozen=True)
class Contact:
    """What the soles did in a run.

    Attributes:
        sink: greatest depth of a sole in the ground [m].
        mean_sink: mean depth of the deepest point [m].
        peak: greatest vertical force on one foot, in body weights.
        slip: greatest distance of a sole from where it stood at the beginning [m]; of stands only.
        speed: mean velocity along the heading in the second half of the run [m/s].
        fell: whether the robot fell.
        step_us: processor time of a physics step with its sensors [us].
    """

    sink: float
    mean_sink: float
    peak: float
    slip: float
    speed: float
    fell: bool
    step_us: float


def controller_named(name: str, robot: Robot, timestep: float) -> Controller:
    """Build "qp" for a robot, at 500 Hz or the nearest rate that the time step [s] allows, or "learned"."""
    if name == "qp":
        period = max(1, round(0.002 / timestep)) * timestep
        return WholeBodyController(period=period, robot=robot)
    from hugwbc.runtime.controllers import learned_controller

    return learned_controller()


def sole_depth(simulation: Simulation) -> float:
    """Return how deep the deepest sphere of a sole is in the ground [m]; negative above it."""
    spheres = simulation.model.geom_type == mujoco.mjtGeom.mjGEOM_SPHERE
    return float(np.max(simulation.model.geom_size[spheres, 0] - simulation.data.geom_xpos[spheres, 2]))


def run(
    name: str, command: Command, physics: Physics, duration: float, load: float = 0.0, settling: float = 0.0
) -> Contact:
    """Let a controller follow one command and watch the soles at every physics step.

    Args:
        name: "qp" or "learned".
        command: command to follow.
        physics: time step, ground and robot.
        duration: length of the run [s].
        load: sideways force on the pelvis after the settling [N].
        settling: time at the start that does not count [s].
    """
    simulation = physics.simulation()
    controller = SafetyFilter(controller_named(name, physics.actuators.known_robot(simulation.robot), physics.timestep))
    state = simulation.reset()
    controller.reset(state)
    substeps = max(1, round(controller.period / physics.timestep))
    depths, forces, speeds, soles = [], [], [], []
    spent, steps = 0.0, 0
    for tick in range(round(duration / controller.period)):
        t = tick * controller.period
        if load and abs(t - settling) < 0.5 * controller.period:
            simulation.apply_force(np.array([0.0, load, 0.0]), duration, "pelvis")
        joint_command = controller.act(simulation.state(), command, UpperBody.none())
        for _ in range(substeps):
            begin = time.process_time()
            state = simulation.step(joint_command, physics.timestep)
            spent, steps = spent + time.process_time() - begin, steps + 1
            if t >= settling and state.foot_force is not None:
                depths.append(sole_depth(simulation))
                forces.append(state.foot_force[:, 2].max())
        assert state.velocity is not None
        if t >= settling:
            soles.append([simulation.data.site(f"{side}_sole").xpos[:2].copy() for side in SIDES])
        if t >= duration / 2.0:
            speeds.append(state.velocity[:2] @ [np.cos(state.yaw), np.sin(state.yaw)])
        if simulation.fallen:
            break
    slip = np.linalg.norm(np.array(soles) - soles[0], axis=-1).max() if soles else np.nan
    weight = simulation.robot.mass * 9.81
    return Contact(
        sink=max(depths, default=np.nan),
        mean_sink=float(np.mean(depths)) if depths else np.nan,
        peak=max(forces, default=np.nan) / weight,
        slip=float(slip),
        speed=float(np.mean(speeds)) if speeds else np.nan,
        fell=simulation.fallen,
        step_us=1e6 * spent / max(steps, 1),
    )


def energy_drift(physics: Physics) -> float:
    """Return the change of the energy of a robot that flies limp, relative to its kinetic energy at the start.

    It is thrown with every joint in motion, without gravity, contacts, joint damping and joint limits: nothing but the
    integrator changes the energy.
    """
    simulation = physics.simulation()
    model, data = simulation.model, simulation.data
    simulation.reset()
    model.opt.gravity[:] = 0.0
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    model.dof_damping[:] = model.dof_frictionloss[:] = 0.0
    rng = np.random.default_rng(0)
    data.qvel[3:] = rng.uniform(-2.0, 2.0, model.nv - 3)
    mujoco.mj_forward(model, data)
    start = data.energy[1]
    zero = np.zeros(model.nu)
    simulation.step(JointCommand(zero, zero, zero, zero, zero), FLIGHT_TIME)
    mujoco.mj_forward(model, data)
    return float((data.energy[1] - start) / start)


def grid() -> Iterator[tuple[str, Physics]]:
    """Yield the physics of the table: time steps, time constants, and solver settings around the chosen one."""
    for timestep in (0.001, 0.002, 0.0025, 0.005):
        for constant in (0.003, 0.004, 0.005, 0.0075, 0.01, 0.02):
            if constant >= 2.0 * timestep:
                yield "firmness", Physics(timestep, Ground(time_constant=constant))
    for iterations in (4, 50):
        yield "solver", Physics(0.002, Ground(time_constant=0.005, iterations=iterations))
    for cone, impratio in (("pyramidal", 10.0), ("elliptic", 1.0), ("elliptic", 10.0)):
        yield "solver", Physics(0.002, Ground(time_constant=0.005, cone=cone, impratio=impratio))


def row(physics: Physics, controllers: Sequence[str]) -> str:
    """Measure one line of the table, in Markdown."""
    ground = physics.ground
    cells = [f"{1e3 * physics.timestep:g}", f"{1e3 * ground.time_constant:g}", ground.cone, f"{ground.impratio:g}"]
    cells += [f"{ground.iterations}", f"{1e2 * energy_drift(physics):.2f} %"]
    step_us = []
    for name in controllers:
        stand = run(name, Command(gait=Gait.STANDING), physics, STAND_TIME, settling=_SETTLING)
        walks = [run(name, Command(v_x=v, gait=Gait.WALKING), physics, WALK_TIME) for v in SPEEDS]
        cells.append(f"{1e3 * stand.sink:.2f}")
        cells.append(", ".join(f"{1e3 * walk.sink:.1f}" + (" (falls)" if walk.fell else "") for walk in walks))
        cells.append(", ".join(f"{walk.peak:.1f}" for walk in walks))
        step_us += [walk.step_us for walk in walks]
    if "qp" in controllers:
        loaded = run("qp", Command(gait=Gait.STANDING), physics, _SETTLING + LOAD_TIME, LOAD, _SETTLING)
        cells.append(f"{1e3 * loaded.slip:.2f}" + (" (falls)" if loaded.fell else ""))
    else:
        cells.append("")
    cells.append(f"{np.mean(step_us):.0f}")
    return "| " + " | ".join(cells) + " |"


def batch_times(count: int, control_steps: int, threads: int, repeats: int = 5) -> dict[str, float]:
    """Measure the step time of many robots with the former and today's physics, in turns.

    Every batch gets the same joint targets: the nominal pose and noise, on which robots stumble and fall.

    Args:
        count: number of robots.
        control_steps: control steps of 20 ms in each turn.
        threads: number of threads.
        repeats: number of turns; the fastest counts.

    Returns:
        Processor time of a control step of all robots by name of the physics [ms].
    """
    earlier, robot = load_robot("h1-2023"), load_robot("h1")
    real = Actuators()

    def firm(of: Robot, actuators: Actuators | None = None) -> BatchSimulation:
        return BatchSimulation(count, threads=threads, robot=of, actuators=actuators, ground=FIRM_GROUND)

    batches = {
        "former: h1-2023, soft ground": BatchSimulation(count, threads=threads, robot=earlier, ground=FORMER_GROUND),
        "h1-2023, firm ground": firm(earlier),
        "h1, firm ground": firm(robot),
        "h1, firm ground, friction": firm(robot, dataclasses.replace(real, torque_speed=False)),
        "h1, firm ground, torque-speed limit": firm(robot, dataclasses.replace(real, friction=0.0)),
        "h1, firm ground, real drives": firm(robot, real),
    }
    best = dict.fromkeys(batches, np.inf)
    substeps = round(0.02 / TRAINING_TIMESTEP)
    for repeat in range(repeats):
        targets = robot.nominal + 0.1 * np.random.default_rng(repeat).standard_normal((control_steps, count, 19))
        for name, batch in batches.items():
            batch.batch.reset(keyframe=0)
            begin = time.process_time()
            for target in targets:
                batch.ctrl[:] = target
                batch.step(substeps)
            best[name] = min(best[name], 1e3 * (time.process_time() - begin) / control_steps)
    return best


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--batch", action="store_true", help="step time of many robots instead")
    parser.add_argument("--robots", type=int, default=1024, help="robots of the batch")
    parser.add_argument("--threads", type=int, default=1, help="threads of the batch")
    parser.add_argument("--controllers", nargs="+", default=["qp", "learned"], help="who walks")
    options = parser.parse_args()
    if options.batch:
        times = batch_times(options.robots, control_steps=25, threads=options.threads)
        former = next(iter(times.values()))
        for name, milliseconds in times.items():
            print(f"| {name} | {milliseconds:.1f} | {milliseconds / former:.2f} |")
        return
    heads = ["time step [ms]", "time constant [ms]", "cone", "impratio", "iterations", "energy drift"]
    figures = ("standing sink [mm]", "landing sink [mm] at .5, 1 m/s", "peak force [body weights]")
    heads += [f"{name}: {figure}" for name in options.controllers for figure in figures]
    heads += ["slip under 40 N [mm]", "step [us]"]
    section = ""
    for name, physics in grid():
        if name != section:
            print(f"\n{name}\n\n| {' | '.join(heads)} |\n|{'---|' * len(heads)}", flush=True)
            section = name
        print(row(physics, options.controllers), flush=True)


if __name__ == "__main__":
    main()
