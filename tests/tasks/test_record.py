"""What touches the objects around the robot is noted, but not what it stands on."""

import mujoco
import numpy as np
import pytest

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


def stand(simulation, x, every=1):
    """Let a stiff robot stand on the step, a moment long, and look at it every few physics steps."""
    watch, robot = TaskWatch(simulation), simulation.robot
    simulation.reset(xy=(x, 0.0))
    simulation.data.qpos[2] += 0.1
    mujoco.mj_forward(simulation.model, simulation.data)
    zero = np.zeros_like(robot.kp)
    for step in range(1, 26):
        simulation.step(JointCommand(q=robot.nominal, dq=zero, kp=robot.kp, kd=robot.kd, tau=zero), simulation.timestep)
        if step % every == 0:
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


def test_each_look_counts_where_there_is_one_in_a_control_period():
    watch = stand(Simulation(scene=SCENE, sensing="exact"), 1.78, every=6)
    assert watch.touched["left_foot", "wall"] == watch.lasted["left_foot", "wall"] == 0.012


@pytest.mark.parametrize("robot", ["h1", "g1"])
def test_thighs_are_called_so_whichever_joint_of_the_hip_moves_them(robot):
    """A thigh is what carries the shank."""
    simulation = Simulation(robot=robot, scene=SCENE, sensing="exact")
    watch, shank = TaskWatch(simulation), simulation.robot.moved["knee"][0]
    thigh = simulation.model.body(simulation.model.body(shank).parentid[0]).name
    watch.touched |= {(thigh, "wall"): 0.0, (shank, "wall"): 0.5}
    assert bumps(watch) == ("the left thigh touched 'wall' at 0.0 s", "the left shank touched 'wall' at 0.5 s")
