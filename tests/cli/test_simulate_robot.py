import dataclasses
import types

import numpy as np
import pytest

from hugwbc import JointCommand
from hugwbc.cli import main, simulate_robot
from hugwbc.cli.simulate_robot import Judge
from hugwbc.sim import Scene, Simulation
from hugwbc.sim.scenes import Wall
from hugwbc.tasks import Milestone, load_task


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--schedule", "1 Strat"], "'1 Strat' in the schedule is not valid"),
        (["--domain", "-1"], "DDS domain is -1"),
        (["--slower", "0.1"], "slower is 0.1; it should be greater than or equal to 1"),
        (["--duration", "0"], "duration is 0"),
        (["--loss", "1"], "loss is 1"),
        (["--jitter", "-1"], "jitter is -1"),
        (["--robot", "h2"], "unknown robot 'h2'"),
    ],
)
def test_simulate_robot_refuses_what_it_cannot_do(words, message, capsys) -> None:
    assert main(["simulate-robot", *words]) == 2
    assert message in capsys.readouterr().err


def test_a_second_robot_in_a_domain_is_refused(monkeypatch, capsys) -> None:
    shared = types.SimpleNamespace(rivals=lambda: 3)
    monkeypatch.setattr(simulate_robot, "DdsEndpoint", lambda **_: shared)
    assert main(["simulate-robot", "--domain", "7"]) == 2
    assert "another robot is simulated in domain 7" in capsys.readouterr().err


def test_a_task_is_judged_from_the_first_command_that_drives_the_joints() -> None:
    simulation = Simulation(scene=Scene((Wall(name="wall", position=(0.4, 0.0), size=(0.1, 1.0, 2.0)),)))
    never = (Milestone("never", lambda record: 0.0),)
    judge = Judge(dataclasses.replace(load_task("press_button"), milestones=never), simulation)
    robot, zero = simulation.robot, np.zeros(19)
    limp = JointCommand(q=robot.nominal, dq=zero, kp=zero, kd=robot.kd, tau=zero)
    for command, steps in ((limp, 120), (JointCommand.position(robot, robot.nominal), 20)):
        for _ in range(steps):
            simulation.step(command, simulation.timestep)
            judge(command)
        assert ("never driven" in judge.words()) == (command is limp)
    assert judge._watch is not None
    assert max(judge._watch.lasted.values(), default=0.0) <= 20 * simulation.timestep
