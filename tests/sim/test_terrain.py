"""Height fields: look-up, errors, and agreement with the ground that MuJoCo collides with."""

import mujoco
import numpy as np
import pytest

from hugwbc.errors import ConfigError
from hugwbc.robot import load_robot
from hugwbc.sim import HeightField, rough_terrain
from hugwbc.sim.robot_model import load_model


def test_heights_by_hand() -> None:
    # Two by three points over 4 m in x and 2 m in y: rows run along y, columns along x.
    field = HeightField(np.array([[0.0, 1.0, 2.0], [10.0, 11.0, 16.0]]), (4.0, 2.0))
    points = np.array([[-2.0, -1.0], [2.0, -1.0], [-2.0, 1.0], [0.0, 0.0], [1.0, 0.5]])
    # The last: in the cell with corners 1, 2 (along x), 11, 16 at u = 0.5, v = 0.75, in the triangle 1, 11, 16:
    # 1 + 0.75 * (11 - 1) + 0.5 * (16 - 11).
    np.testing.assert_allclose(field.height_at(points), [0, 2, 10, 6, 11])
    # Across the diagonal, u = 0.75, v = 0.5, in the triangle 1, 2, 16: 1 + 0.75 * (2 - 1) + 0.5 * (16 - 2).
    assert field.height_at(np.array([1.5, 0.0])) == pytest.approx(8.75)
    assert field.height_at(np.array([100.0, -100.0])) == 2.0  # beyond the edge, the edge's


def test_a_slope_rises_along_x_below_the_same_roughness() -> None:
    level, sloped = (rough_terrain(0.02, np.random.default_rng(7), size=4.0, slope=slope) for slope in (0.0, 0.1))
    points = np.random.default_rng(0).uniform(-2.0, 2.0, (50, 2))
    rise = sloped.height_at(points) - level.height_at(points)
    np.testing.assert_allclose(rise, np.tan(0.1) * points[:, 0], atol=1e-12)
    assert sloped.gradient == (pytest.approx(np.tan(0.1)), 0.0) and level.gradient == (0.0, 0.0)


FLAT, RNG = np.zeros((2, 2)), np.random.default_rng(0)


@pytest.mark.parametrize(
    ("make", "values", "message"),
    [
        (lambda x: rough_terrain(0.0, RNG, slope=x), (1.0, -0.8, np.nan), "slope is .* from -0.78 to 0.78 rad"),
        (lambda x: rough_terrain(x, RNG), (-0.1, np.nan, np.inf, 1.0), "amplitude is .* a height from 0 to 1 m"),
        (lambda x: HeightField(FLAT, (1.0, 1.0), (x, 0.0)), (np.nan,), "give dz/dx and dz/dy from -1 to 1"),
        (lambda x: HeightField(FLAT, (x, 1.0)), (0.0, -1.0, np.nan, np.inf), "give finite extents above 0"),
        (
            lambda x: HeightField(np.array(x), (1.0, 1.0)),
            ([0.0], [[0.0] * 5], [[0.0, np.nan], [0.0, 0.0]]),
            "2 x 2 fin",
        ),
        (
            lambda x: load_model(x, robot=load_robot()),
            (0.0, -0.002, 0.02, np.nan),
            "physics time step is .* above 0 and up to 0.01 s",
        ),
    ],
    ids=["slope", "amplitude", "gradient", "size", "heights", "time step"],
)
def test_what_is_out_of_range_is_refused(make, values, message: str) -> None:
    for value in values:
        with pytest.raises(ConfigError, match=message):
            make(value)


def test_the_ground_around_the_start_can_be_level() -> None:
    field = rough_terrain(0.05, np.random.default_rng(7), size=4.0, spacing=0.2, start_radius=1.0)
    angle = np.linspace(-np.pi, np.pi, 50)
    inside = 0.7 * np.stack((np.cos(angle), np.sin(angle)), axis=-1)
    assert not field.height_at(inside).any()
    assert np.abs(field.height_at(2.0 * inside)).min() > 0.0


def test_rough_terrain_stays_within_its_amplitude_and_is_seeded() -> None:
    field = rough_terrain(0.05, np.random.default_rng(7), size=4.0, spacing=0.5)
    assert field.heights.shape == (9, 9)
    assert 0.03 < np.abs(field.heights).max() <= 0.05
    np.testing.assert_array_equal(
        field.heights, rough_terrain(0.05, np.random.default_rng(7), size=4.0, spacing=0.5).heights
    )


def test_lookup_agrees_with_rays_onto_mujocos_ground() -> None:
    rng = np.random.default_rng(3)
    field = HeightField(rng.uniform(-0.1, 0.2, (21, 31)), (6.0, 4.0))
    model = load_model(0.005, field, robot=load_robot())
    data = mujoco.MjData(model)
    data.qpos[:3] = [50.0, 50.0, 5.0]  # the robot out of the way
    mujoco.mj_forward(model, data)

    def ground(x: float, y: float) -> float:
        hit = np.array([-1], dtype=np.int32)
        distance = mujoco.mj_ray(model, data, np.array([x, y, 2.0]), np.array([0.0, 0.0, -1.0]), None, 1, -1, hit, None)
        assert model.geom(hit[0]).name == "floor"
        return 2.0 - distance

    for x, y in rng.uniform([-2.9, -1.9], [2.9, 1.9], (200, 2)):
        # MuJoCo keeps heights in single precision.
        assert ground(x, y) == pytest.approx(float(field.height_at(np.array([x, y]))), abs=1e-5)
