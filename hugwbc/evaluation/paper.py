"""The figures printed in the HugWBC paper (Xue et al., RSS 2025), read from `paper_tables.yaml`."""

import functools
import pathlib
from collections.abc import Mapping
from typing import Any

import yaml

from hugwbc.gait import Gait

# The paper's names of the tracking errors in the order of its table, with their units.
ERROR_UNITS = {
    "E_vx_low": "m/s",
    "E_vx_high": "m/s",
    "E_vy": "m/s",
    "E_omega": "rad/s",
    "E_f": "Hz",
    "E_l": "m",
    "E_h": "m",
    "E_p": "rad",
    "E_w": "rad",
}
# What moved the arms in training, in the paper's ablation, with the words for it.
TRAININGS = {"noise": "trained with noise", "motion": "trained with motions", "none": "trained without intervention"}
ROBOT = "h1"  # of the paper
HIGH_SPEED = 1.0  # [m/s]; a faster v_x counts towards E_vx_high


@functools.cache
def _tables() -> Mapping[str, Any]:
    return yaml.safe_load((pathlib.Path(__file__).parent / "paper_tables.yaml").read_text())


def single_command_errors(gait: Gait, intervention: str = "none") -> Mapping[str, float]:
    """Return the paper's single-command tracking errors of a gait by name, as far as it reports them.

    The paper has one column for hopping on either leg, and no intervention (none, noise or motion) for it. Its table
    with intervention does not split E_vx by speed.
    """
    if intervention == "none":
        return _tables()["single_command_tracking"]["hopping" if gait.hops else gait.label]
    return intervention_errors(gait, intervention)


def intervention_errors(gait: Gait, intervention: str, training: str = "noise") -> Mapping[str, float]:
    """Return the paper's errors with the arms moved by an intervention, by name, with E_vx at all speeds.

    The training is one of `TRAININGS`. There are no figures of hopping.
    """
    return _tables()["intervention_tracking"].get(gait.label, {}).get(training, {}).get(intervention, {})


def foot_displacement(intervention: str, training: str = "noise") -> Mapping[str, float]:
    """Return the paper's foot displacement in 20 s of standing [m], by command: h, p and w."""
    return _tables()["foot_displacement_standing"][training].get(intervention, {})


def real_robot_errors(gait: Gait) -> Mapping[str, float]:
    """Return E_p and E_w of the paper's test on the real robot; empty for hopping."""
    return _tables()["real_robot"].get(gait.label, {})


def other_controllers() -> Mapping[str, Mapping[str, float]]:
    """Return the walking errors that the paper prints for other controllers, by controller and error."""
    return _tables()["other_controllers_walking"]


def error_name(command: str, value: float) -> str:
    """Return the name of the error for an episode with one sampled command; E_vx is split by speed."""
    if command == "v_x":
        return "E_vx_high" if value > HIGH_SPEED else "E_vx_low"
    return f"E_{command.replace('_', '')}"
