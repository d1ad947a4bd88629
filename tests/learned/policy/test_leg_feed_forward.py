import numpy as np
import pytest
import torch

from hugwbc.commands import COMMAND_NAMES, command_ranges, highest_swing
from hugwbc.gait import Gait
from hugwbc.kinematics import Kinematics
from hugwbc.learned.config import EnvConfig
from hugwbc.learned.policy.leg_feed_forward import (
    HEIGHT_RATE,
    PITCH_RATE,
    CommandFeedForward,
    LegFeedForward,
    swing_clearance,
)
from hugwbc.robot import Robot, load_robot
from tests.conftest import make_state

ROBOT = load_robot("h1")


def clearance(q: np.ndarray, height: float, pitch: float, robot: Robot = ROBOT) -> tuple[float, ...]:
    """Return the heights of both soles [m] with the pelvis at a height over the nominal one [m] and a pitch [rad]."""
    kinematics = Kinematics(robot=robot)
    place = (0.0, 0.0, robot.nominal_height + height)
    kinematics.update(make_state(q, pitch=pitch, position=place, velocity=np.zeros(3)))
    return kinematics.measured().clearance


@pytest.mark.parametrize("name", ["h1", "g1"])
@pytest.mark.parametrize(
    ("height", "pitch"), [(0.0, 0.0), (-0.1, 0.0), (-0.2, 0.0), (-0.3, 0.0), (0.0, 0.4), (-0.2, 0.3)]
)
def test_soles_of_a_squat_are_on_the_ground(name: str, height: float, pitch: float) -> None:
    """The thighs of a G1 are 37 mm longer than its shanks."""
    robot = load_robot(name)
    q = robot.nominal + LegFeedForward(robot).offsets(np.array([height]), np.array([pitch]))[0]
    np.testing.assert_allclose(clearance(q, height, pitch, robot), 0.0, atol=6e-3 if name == "h1" else 9e-3)
    assert (q > robot.lower).all() and (q < robot.upper).all()
    pitches = np.array([robot.pair(part) for part in ("hip_pitch", "knee", "ankle_pitch")])
    np.testing.assert_allclose(q[pitches].sum(0), -pitch, atol=1e-6, err_msg="the soles are level")
    others = np.setdiff1d(np.arange(len(q)), robot.legs)
    np.testing.assert_array_equal(q[others], robot.nominal[others])


def test_soles_are_lifted_by_the_clearance() -> None:
    lifted = np.array([[0.2, 0.0]])
    q = ROBOT.nominal + LegFeedForward(ROBOT).offsets(np.array([-0.1]), np.array([0.1]), lifted)[0]
    np.testing.assert_allclose(clearance(q, -0.1, 0.1), lifted[0], atol=1e-2)


@pytest.mark.parametrize("name", ["h1", "g1"])
def test_swings_beyond_all_commands_lift_higher_with_the_toes_down(name: str) -> None:
    """A stance leg, and a swing up to the highest command, have a level sole and stay within the joints' ranges."""
    robot = load_robot(name)
    legs, highest = LegFeedForward(robot), highest_swing(robot)
    lifted = highest + np.array([[0.0, 0.0], [0.05, 0.0], [0.15, 0.0], [0.3, 0.0]]) - [0.0, highest]
    q = robot.nominal + legs.offsets(np.zeros(4), np.zeros(4), lifted)
    (hip, _), (knee, _), (ankle, _) = (robot.pair(part) for part in ("hip_pitch", "knee", "ankle_pitch"))
    alone = robot.nominal + legs.offsets(np.zeros(1), np.zeros(1), np.array([[highest, 0.0]]))[0]
    np.testing.assert_array_equal(q[0], alone)
    assert (q[0] >= robot.lower).all() and (q[0] <= robot.upper).all()
    raised = [clearance(one, 0.0, 0.0, robot)[0] for one in np.minimum(q, robot.upper)]
    assert (np.diff(raised) > 0.005).all(), raised
    tilts = (q[:, hip] + q[:, knee] + q[:, ankle]) - (q[0, hip] + q[0, knee] + q[0, ankle])
    assert (np.diff(tilts) > 0.0).all() and tilts[-1] < 0.6, tilts
    assert (q[:, knee] < robot.upper[knee] + 0.75).all() and q[-1, knee] > robot.upper[knee]
    others = np.setdiff1d(np.arange(q.shape[1]), [hip, knee, ankle])
    np.testing.assert_array_equal(q[:, others], np.broadcast_to(q[0, others], (4, len(others))))


def test_the_clearance_is_that_of_the_clock_one_period_later() -> None:
    command = np.zeros((3, 8))
    command[:, COMMAND_NAMES.index("f")], command[:, COMMAND_NAMES.index("l")] = 2.0, 0.2
    gait = np.array([Gait.WALKING, Gait.HOPPING_LEFT, Gait.STANDING])
    result = swing_clearance(np.full(3, 0.21), gait, command, 0.02)  # the left foot is at 0.75 in a walk
    np.testing.assert_allclose(result, [[0.2, 0.0], [0.0, 0.2], [0.0, 0.0]], atol=1e-9)


def test_training_and_deployment_move_the_legs_alike() -> None:
    rng, contract = np.random.default_rng(0), EnvConfig(squat_gain=1.2, swing_gain=0.7).contract()
    low, high = np.array([limits.initial for limits in command_ranges(Gait.WALKING).values()]).T
    given = [rng.uniform(-0.2, 0.2, 64), rng.uniform(-0.2, 0.2, (64, 2))]
    told = [rng.uniform(0.0, 1.0, 64), np.arange(64) % len(Gait), rng.uniform(low, high, (64, 8))]
    deployed, trained = CommandFeedForward(contract), CommandFeedForward(contract, torch.as_tensor)
    here = [*deployed.follow(*given, told[2]), deployed.offsets(*given, *told)]
    tensors = [[torch.from_numpy(value) for value in values] for values in (given, told)]
    there = [*trained.follow(*tensors[0], tensors[1][2]), trained.offsets(*tensors[0], *tensors[1])]
    for one, other in zip(here, there, strict=True):
        np.testing.assert_allclose(other.numpy(), one, atol=1e-12)


def test_absurd_commands_stay_within_the_joints_ranges() -> None:
    offsets = LegFeedForward(ROBOT).offsets(np.array([-5.0, 5.0]), np.array([9.0, -9.0]))
    q = ROBOT.nominal + offsets
    assert np.isfinite(q).all() and (q >= ROBOT.lower).all() and (q <= ROBOT.upper).all()


def test_it_follows_at_its_rates() -> None:
    commanded = CommandFeedForward(EnvConfig(squat_gain=1.0).contract())
    command = np.zeros((2, 8))
    command[:, [COMMAND_NAMES.index(name) for name in ("h", "p", "w")]] = [[-0.3, 0.4, -1.0], [-0.001, 0.0, 0.01]]
    waist, posture = commanded.follow(np.zeros(2), np.zeros((2, 2)), command)
    np.testing.assert_allclose(waist, [-0.04, 0.01])
    np.testing.assert_allclose(posture, [[-0.02 * HEIGHT_RATE, 0.02 * PITCH_RATE], [-0.001, 0.0]])
