"""Curricula that another package registers."""

import math

import pytest

from hugwbc.errors import ConfigError
from hugwbc.learned.config import CurriculumConfig, EnvConfig, LoadConfig, environment
from hugwbc.learned.config.own_settings import CURRICULA, registered_curricula, with_registered
from hugwbc.learned.env.curriculum import Curriculum
from hugwbc.learned.env.humanoid_env import HumanoidEnv
from hugwbc.learned.env.own_curricula import OwnCurriculum

MASS = {"loads.payload": (0.5, 2.5)}


@pytest.fixture
def register(monkeypatch, install):
    """The function that registers curricula of a module `own_levels`, and returns the class of settings."""
    plain = environment.CurriculumConfig

    def register(**found):
        install("own_levels", CURRICULA, found)
        registered_curricula.cache_clear()
        settings = with_registered(plain, registered_curricula(), "curriculum", ("alpha",))
        monkeypatch.setattr(environment, "CurriculumConfig", settings)
        return settings

    yield register
    monkeypatch.undo()
    registered_curricula.cache_clear()


def climb(level, measured):
    """Rise by a quarter at each move."""
    return level + 0.25


def _env(config):
    return HumanoidEnv(EnvConfig(count=2, curriculum=config), seed=0, threads=1)


def test_without_such_packages_the_settings_are_what_they_were():
    assert registered_curricula() == {}
    assert with_registered(CurriculumConfig, registered_curricula(), "curriculum") is CurriculumConfig
    assert set(Curriculum(CurriculumConfig()).state_dict()) == {"iteration", "penalty_scale", "alpha", "max_speed"}


def test_numbers_follow_the_level_up_to_how_high_it_may_rise(register):
    settings = register(heavier=OwnCurriculum(climb, MASS))
    env = _env(settings(warm_up_iterations=1, heavier=0.6))
    payloads = []
    for _ in range(4):
        payloads.append(env.config.loads.payload)
        env.update_curriculum()
    # Two moves at the lower end, the second because of the warm-up; then a quarter of 2 kg each.
    assert payloads == pytest.approx([0.5, 0.5, 1.0, 1.5])
    assert env.config.loads.payload == env.loads.config.payload == pytest.approx(0.5 + 0.6 * 2.0)
    assert env.curriculum.gates["heavier"] == "0.600" and env.levels["level/heavier"] == 0.6
    env.adopt(EnvConfig(count=2, curriculum=env.config.curriculum))
    assert env.config.loads.payload == pytest.approx(1.7), "a schedule moves other numbers, not this one"


def test_it_is_off_until_a_height_is_given(register):
    env = _env(register(heavier=OwnCurriculum(climb, MASS))(warm_up_iterations=0))
    env.update_curriculum()
    assert env.config.loads.payload == LoadConfig().payload and "heavier" not in env.curriculum.gates


def test_the_level_is_part_of_the_state(register):
    config = register(heavier=OwnCurriculum(climb, MASS))(warm_up_iterations=0, heavier=1.0)
    env, again = _env(config), _env(config)
    env.update_curriculum()
    again.load_state_dict(env.state_dict())
    assert again.curriculum.own.values == {"heavier": 0.25} and again.config.loads.payload == 1.0
    older = {name: value for name, value in env.curriculum.state_dict().items() if not name.startswith("own_")}
    again.restore_levels(older)
    assert again.config.loads.payload == 0.5


def _late(level, measured):
    return level + 0.5 if measured.iteration == 0 else 1 / 0


@pytest.mark.parametrize(
    ("rule", "words"),
    [(_late, "ZeroDivisionError"), (lambda level, measured: math.nan if measured.iteration else 0.0, "gives nan")],
)
def test_a_rule_that_fails_during_the_training_leaves_its_level(register, rule, words):
    env = _env(register(late=OwnCurriculum(rule, MASS))(warm_up_iterations=0, late=1.0))
    env.update_curriculum()
    assert env.curriculum.own.values == {"late": 0.0} and words in env.curriculum.gates["late"]


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (climb, "is a function; register an OwnCurriculum"),
        (OwnCurriculum(lambda *both: both[2], MASS), "fails: IndexError"),
        (OwnCurriculum(lambda level, measured: math.inf, MASS), "gives inf; return a number"),
        (OwnCurriculum(climb, {"loads.payload": (0.0, math.inf)}), "give two finite numbers"),
        (OwnCurriculum(climb, {"loads.nothing": (0.0, 1.0)}), "moves loads.nothing, which is no number of"),
        (OwnCurriculum(climb, {"count": (1.0, 2.0)}), "moves count, which is no number of"),
        (OwnCurriculum(climb, {"command.standing_fraction": (0.0, 2.0)}), "at level 1: command.standing_fraction"),
    ],
)
def test_one_that_does_not_work_is_refused(register, wrong, message):
    with pytest.raises(ConfigError, match=rf"curriculum 'wrong' \(own_levels:wrong\) .*{message}"):
        _env(register(wrong=wrong)(wrong=1.0))


def test_two_that_move_one_number_are_refused(register):
    settings = register(one=OwnCurriculum(climb, MASS), two=OwnCurriculum(climb, MASS))
    with pytest.raises(ConfigError, match=r"'two'.* and 'one' both move loads\.payload"):
        _env(settings(one=1.0, two=1.0))


@pytest.mark.parametrize("height", [-0.1, 1.1, math.nan])
def test_a_height_is_checked(register, height):
    with pytest.raises(ConfigError, match="heavier"):
        register(heavier=OwnCurriculum(climb, MASS))(heavier=height)


def test_names_that_are_taken_are_refused(register):
    with pytest.raises(ConfigError, match="has the name of a curriculum of hugwbc"):
        register(alpha=OwnCurriculum(climb, MASS))
