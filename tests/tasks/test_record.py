"""What touches the objects around the robot is noted, but not what it stands on."""

import mujoco
import numpy as np

from hugwbc import JointCommand
from hugwbc.sim import Scene, Simulation
from hugwbc.sim.scenes import Step, Wall
from hugwbc.tasks.record import TaskWatch, bumps

SCENE = Scene(
    (
        Step(name="step", position=(1.5, 0.0), size=(0.9, 1.0, 0.1)),
        Wall(name="wall", position=(2.0, 0.0), size=(0.1, 1.0, 2.0)),
    )
)


def stand(simulation, x):
    """Let a stiff robot stand on the step, a moment long, and watch it."""
    watch, robot = TaskWatch(simulation), simulation.robot
    simulation.reset(xy=(x, 0.0))
    simulation.data.qpos[2] += 0.1
    mujoco.mj_forward(simulation.model, simulation.data)
    zero = np.zeros_like(robot.kp)
    for _ in range(25):
        simulation.step(JointCommand(q=robot.nominal, dq=zero, kp=robot.kp, kd=robot.kd, tau=zero), simulation.timestep)
        watch.look()
    return watch


def test_a_toe_at_a_wall_is_named_and_a_sole_on_a_step_is_not():
    simulation = Simulation(scene=SCENE, sensing="exact")
    assert bumps(stand(simulation, 1.4)) == ()
    assert np.linalg.norm(simulation.state().foot_force, axis=-1).min() > 10.0
    watch = stand(simulation, 1.78)
    assert bumps(watch)[0].startswith("the left foot touched 'wall' at 0.0 s")
    assert {body for _, body in watch.touched} == {"wall"}
    assert 0.0 < max(watch.lasted.values()) <= 25 * simulation.timestep
