import pathlib

import pytest

from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.learned.config import EnvConfig, TrainConfig
from hugwbc.learned.recipe.dotted import flat, setting_types, unknown_setting, with_settings


def test_every_setting_of_a_training_has_a_dotted_name() -> None:
    types = setting_types(TrainConfig)
    assert types["env.command.walking_fraction"] is float and types["ppo.epochs"] is int
    assert types["start_from"] == pathlib.Path | None
    assert set(types) == set(flat(TrainConfig()))


def test_settings_are_replaced_wherever_they_are() -> None:
    config = with_settings(TrainConfig(), {"ppo.beta": 0.1, "env.extra.alive": 1.0, "seed": 2003})
    assert (config.ppo.beta, config.env.extra.alive, config.seed) == (0.1, 1.0, 2003)
    assert config.ppo.gamma == TrainConfig().ppo.gamma


def test_a_group_is_checked_with_all_its_new_values() -> None:
    shares = {"command.standing_fraction": 0.05, "command.walking_fraction": 0.95}
    assert with_settings(EnvConfig(), shares).command.fractions()["jumping"] == 0.0
    with pytest.raises(ConfigError, match="at most 1"):
        with_settings(EnvConfig(), {"command.walking_fraction": 0.95})


def test_an_unknown_setting_is_refused_with_the_nearest_one() -> None:
    with pytest.raises(UnknownNameError, match=r"unknown setting 'env\.cuont'. Did you mean 'env\.count'"):
        with_settings(TrainConfig(), {"env.cuont": 3})


def test_the_error_lists_the_settings_of_the_group_and_the_other_groups() -> None:
    text = str(unknown_setting("ppo.bta", setting_types(TrainConfig)))
    assert "ppo.gamma" in text and "env.command.*" in text and "env.command.walking_fraction" not in text
    assert "'env.randomization.gains'" in str(unknown_setting("env.randomisation.gains", setting_types(TrainConfig)))
    assert "save_interval" in str(unknown_setting("nothing", setting_types(TrainConfig)))
