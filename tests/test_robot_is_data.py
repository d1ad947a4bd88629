"""No robot in the code: links, joints and the default robot are named in tables and at the command line only."""

import ast
import pathlib
import re

import numpy as np
import pytest

import hugwbc
from hugwbc import Command, Robot, UpperBody, load_robot
from hugwbc.arm_servo import ArmServo
from hugwbc.controller import JointCommand
from hugwbc.kinematics import Kinematics
from hugwbc.mbc import WholeBodyController
from hugwbc.robot import load_mirror
from hugwbc.robot_tables import robot_names, robot_table
from hugwbc.sim import Simulation
from hugwbc.sim.robot_model import Variation
from hugwbc.targets import HandTargets
from hugwbc.upper_ik import UpperBodySource
from tests.conftest import ByHand

ROOT = pathlib.Path(hugwbc.__file__).parent
# May choose the default robot: `Simulation()` and the command line.
CHOOSERS = ("cli/", "sim/engine.py")
SIZES = {19, 26, 63, 315, 333}  # of the H1: joints, positions, frame, history, policy's observation


def _code() -> dict[str, str]:
    return {str(path.relative_to(ROOT)): path.read_text() for path in ROOT.rglob("*.py")}


def test_no_link_and_no_joint_is_named() -> None:
    """Names without their side, since code puts them together; the base's own name is also that of a hand frame."""
    tables = [robot_table(name) for name in robot_names()]
    names = {part["name"] for table in tables for kind in ("links", "joints") for part in table[kind]}
    names -= {table["roles"]["base"] for table in tables}
    pattern = re.compile("|".join({re.sub("^(left|right)_", "", name) for name in names}) + r'|\w\("pelvis"\)')
    found = {file: pattern.findall(text) for file, text in _code().items()}
    assert {file: names for file, names in found.items() if names} == {}


def test_no_size_of_the_h1_is_in_the_code() -> None:
    found = {}
    for file, text in _code().items():
        numbers = [node.value for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Constant)]
        if here := [number for number in numbers if type(number) is int and number in SIZES]:
            found[file] = here
    assert found == {"viz/video.py": [26], "settings.py": [63]}, "but the pixels of a text, and the bits of a seed"


def test_who_takes_the_default_robot() -> None:
    found = {file for file, text in _code().items() if "load_robot()" in text}
    assert {file for file in found if not file.startswith(CHOOSERS)} == set()


@pytest.fixture(scope="module")
def g1() -> Robot:
    return load_robot("g1")


@pytest.fixture(scope="module")
def simulation(g1: Robot) -> Simulation:
    return Simulation(robot=g1)


def test_the_rooms_count_the_joints_of_a_second_robot(g1: Robot, simulation: Simulation) -> None:
    """29 joints and 14 joints of arms in the core, sim, mbc, upper_ik and runtime, without a word about the H1."""
    state = simulation.reset()
    assert state.q.shape == state.dq.shape == (29,) and simulation.qpos.shape == (36,)
    assert Kinematics(g1).model.nv == 35
    np.testing.assert_array_equal(load_mirror(g1).joints(load_mirror(g1).joints(state.q)), state.q)
    none = UpperBody.none()
    period = ByHand(WholeBodyController(g1), g1)
    period.start(state)
    assert period.act(state, Command(), none).q.shape == (29,) and period.report().failures == 0
    source = UpperBodySource(g1)
    hands = HandTargets.of(left=(0.25, 0.15, 0.1), right=(0.25, -0.15, 0.1), frame="pelvis")
    arms, _ = source.update(state, hands, Command(), 0.02)
    assert arms.q.shape == (14,) and ArmServo(g1)(arms, state, 0.02).tau.shape == (14,)


def test_a_record_of_another_robot_is_refused(g1: Robot, simulation: Simulation) -> None:
    """A state and a command of 19 joints reach neither the controller nor the drives of 29."""
    small = load_robot("h1")
    period = ByHand(WholeBodyController(g1), g1)
    period.start(simulation.state())
    period.act(Simulation(robot=small).state(), Command(), UpperBody.none())
    assert period.report().bad_states == 1
    before = simulation.rejected_commands
    simulation.step(JointCommand.position(small, small.nominal), 0.002)
    assert simulation.rejected_commands == before + 1


def test_loads_and_grips_are_at_the_hands_of_the_robot_and_not_at_its_elbows(g1: Robot) -> None:
    """A G1 has links of both names: 1 kg in each hand is on the links of the hands, 3 kg of payload on the trunk."""
    plain, loaded = (Simulation(robot=g1, variation=v).model for v in (None, Variation(payload=3.0, hand_payload=1.0)))
    heavier = loaded.body_mass - plain.body_mass
    found = {plain.body(i).name: round(float(heavier[i]), 9) for i in np.flatnonzero(heavier)}
    assert found == {"torso_link": 3.0, "left_wrist_yaw_link": 1.0, "right_wrist_yaw_link": 1.0}
