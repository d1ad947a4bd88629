import torch

from hugwbc.learned.env.humanoid_env import HumanoidEnv
from hugwbc.learned.env.sensor_errors import SensorErrors
from hugwbc.sim.sensors import ROBOT


def test_errors_have_the_profile_s_spread_and_biases_stay_for_an_episode(small_env: HumanoidEnv) -> None:
    errors = SensorErrors(8, 19, (1.0, 1.0), torch.Generator().manual_seed(0))
    errors.reset(torch.arange(8))
    truth = small_env.readings
    read = [errors.sensed(truth) for _ in range(400)]
    for name, noise, bias in (("q", ROBOT.encoder, ROBOT.encoder_offset), ("dq", ROBOT.joint_velocity, 0.0),
                              ("angular_velocity", ROBOT.gyro, ROBOT.gyro_bias)):  # fmt: skip
        error = torch.stack([getattr(one, name) - getattr(truth, name) for one in read])
        assert 0.9 * noise < error.std(0).mean() < 1.1 * noise, name
        assert abs(error.mean(0).square().mean().sqrt() - bias) < 0.4 * bias + 0.1 * noise, name
    torch.testing.assert_close(torch.linalg.vector_norm(read[0].gravity, dim=1), torch.ones(8))
    tilt = torch.stack([torch.linalg.cross(truth.gravity, one.gravity) for one in read]).mean(0)
    assert 0.3 * ROBOT.attitude_bias < tilt[:, :2].square().mean().sqrt() < 2.0 * ROBOT.attitude_bias
    before = errors.gyro_bias.clone()
    errors.reset(torch.tensor([3]))
    changed = (errors.gyro_bias != before).any(1)
    assert changed.tolist() == [i == 3 for i in range(8)]


def test_each_robot_has_its_own_factor_and_zero_is_the_truth(small_env: HumanoidEnv) -> None:
    exact = SensorErrors(8, 19, (0.0, 0.0), torch.Generator().manual_seed(0))
    exact.reset(torch.arange(8))
    assert exact.sensed(small_env.readings) is small_env.readings
    factors = SensorErrors(500, 19, (0.5, 1.5), torch.Generator().manual_seed(0)).scale
    assert 0.5 <= factors.min() < 0.6 and 1.4 < factors.max() <= 1.5
