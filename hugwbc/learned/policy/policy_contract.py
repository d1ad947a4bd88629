"""The contract of a policy file: everything that is needed to run the network elsewhere."""

import dataclasses
import importlib.metadata
import json
import math
import pathlib
import platform
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hugwbc import gait as gaits
from hugwbc.commands import COMMAND_NAMES, command_ranges
from hugwbc.errors import ConfigError, PolicyFileError, UnknownNameError
from hugwbc.gait import Gait
from hugwbc.learned import ACTION_SCALE, PERIOD, WAIST_RATE
from hugwbc.learned.policy import layout as obs
from hugwbc.learned.policy.own_terms import own_terms
from hugwbc.robot import Robot, load_robot, robot_names

CONTRACT_VERSION = 2
# Entries that a policy may choose, with the valid range of their numbers; the others must equal this version's.
_OWN_NUMBERS = {"period": (1e-4, 1.0), "waist_rate": (0.0, 1e6), "squat_gain": (0.0, 1.0), "swing_gain": (0.0, 1.0)}
_OWN_VECTORS = {"nominal": (-math.pi, math.pi), "kp": (0.0, 1e4), "kd": (0.0, 1e4), "action_scale": (1e-6, 10.0)}
_TERM = "term"  # key of the name of a term of another package, in the layout of the command observation
_FIXED = (
    "joint_names",
    "history_frames",
    "proprioception",
    "command",
    "command_names",
    "command_scales",
    "estimate",
    "gait",
    "network",
)


def versions() -> dict[str, str]:
    """Return the versions that a result depends on."""
    packages = ("hugwbc", "mujoco", "numpy", "safetensors", "torch")
    return {
        "python": platform.python_version(),
        "machine": platform.machine(),
        **{package: version for package in packages if (version := _version(package)) is not None},
    }


def _version(package: str) -> str | None:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:  # torch, which running an exported network does not need
        return None


def settings_record(settings: Any) -> dict[str, Any]:  # noqa: ANN401  any dataclass
    """Return settings in a form that JSON can hold, for the record of a policy.

    Folders mean nothing on another machine: of a path only the last two parts are kept, and of `out` nothing.
    """
    record = json.loads(json.dumps(dataclasses.asdict(settings), default=_last_parts))
    record.pop("out", None)
    return record


def _last_parts(value: object) -> str:
    return "/".join(value.parts[-2:]) if isinstance(value, pathlib.PurePath) else str(value)


def policy_contract(
    *,
    period: float = PERIOD,
    action_scale: ArrayLike = ACTION_SCALE,
    waist_rate: float = WAIST_RATE,
    squat_gain: float = 0.0,
    swing_gain: float = 0.0,
    kp: ArrayLike | None = None,
    kd: ArrayLike | None = None,
    robot: Robot | None = None,
    own: Sequence[str] = (),
) -> dict[str, Any]:
    """Return the contract of a policy trained with this version, in a form that JSON can hold; SI units, radians.

    Args:
        period: time between two actions [s].
        action_scale: radians of joint target per unit of action, one number or one per joint.
        waist_rate: speed at which the waist's joint target follows the commanded w [rad/s].
        squat_gain: share of the commanded height and pitch that the legs' joint targets follow.
        swing_gain: share of the clock's swing of the feet, up to the commanded height, that they follow.
        kp: stiffness of the training [N*m/rad], shape (19,); None for the robot's own.
        kd: damping of the training [N*m*s/rad], shape (19,); None for the robot's own.
        robot: robot of the training; None for the H1.
        own: names of the observation terms of other packages that it reads.

    Raises:
        UnknownNameError, ConfigError: if a term is not there, or does not work.
    """
    robot = robot or load_robot()
    ranges = command_ranges(Gait.WALKING)
    return {
        "contract": CONTRACT_VERSION,
        "robot": robot.name,
        "joint_names": list(robot.joint_names),
        "nominal": robot.nominal.tolist(),
        "kp": np.asarray(robot.kp if kp is None else kp).tolist(),
        "kd": np.asarray(robot.kd if kd is None else kd).tolist(),
        "lower": robot.lower.tolist(),
        "upper": robot.upper.tolist(),
        "velocity_limit": robot.velocity_limit.tolist(),
        "torque_limit": robot.torque_limit.tolist(),
        "period": period,
        "action_scale": np.broadcast_to(np.asarray(action_scale, dtype=float), robot.kp.shape).tolist(),
        "waist_rate": waist_rate,
        "squat_gain": squat_gain,
        "swing_gain": swing_gain,
        "leg_length": robot.leg_length,
        "history_frames": obs.HISTORY_FRAMES,
        "proprioception": _layout(obs.FRAME),
        "command": [*_layout(obs.COMMAND), *_own_layout(own)],
        "command_names": list(COMMAND_NAMES),
        "command_scales": obs.COMMAND_SCALES,
        "command_defaults": {name: ranges[name].default for name in COMMAND_NAMES},
        "estimate": _layout(obs.ESTIMATE),
        "gait": {
            "values": {gait.label: int(gait) for gait in Gait},
            "duty": gaits.DEFAULT_DUTY,
            "walking_offset_of_left_foot": Gait.WALKING.phase_offset,
            "standing_phase": gaits.STANDING_PHASE,
            "phase_of_the_held_leg_hopping": gaits.FLYING_PHASE,
            "phase": "0 at the start; advanced by f * period, modulo 1, before every call",
            "clock": "sin(2 pi phase of the foot)",
        },
        "network": {
            "encoder": list(obs.ENCODER_HIDDEN),
            "latent": obs.LATENT_SIZE,
            "estimator": list(obs.ESTIMATOR_HIDDEN),
            "policy": list(obs.POLICY_HIDDEN),
            "activation": "elu",
            "policy_input": "latent, estimate, newest frame, command",
        },
        "joint_target": "nominal + action_scale * action; the waist's plus w, followed at waist_rate from 0; "
        "the legs' plus the posture of squat_gain * the commanded h and p, "
        "with soles lifted by swing_gain * the clock's swing one period later, minus the nominal: "
        "knee = 2 acos(d / leg_length), hip pitch = -knee / 2 - p, ankle = -knee / 2, "
        "d = leg_length cos(nominal knee / 2) + h - swing",
        "versions": versions(),
    }


def command_size(metadata: dict[str, Any]) -> int:
    """Return the width of a policy's command observation from its contract."""
    return sum(int(part["size"]) for part in metadata["command"])


def own_names(metadata: dict[str, Any]) -> list[str]:
    """Return the names of the observation terms of other packages that a policy reads, from its contract."""
    return [part[_TERM] for part in metadata["command"] if _TERM in part]


def _own_layout(names: Sequence[str]) -> list[dict[str, Any]]:
    terms = own_terms(names)
    return [part | {_TERM: name} for part, name in zip(_layout(terms), names, strict=True)]


def _layout(parts: Iterable[obs.Part]) -> list[dict[str, Any]]:
    return [{"name": part.about, "size": part.size, "scale": part.scale} for part in parts]


def complete_contract(metadata: dict[str, Any], origin: object) -> dict[str, Any]:
    """Return the contract of a policy file after checking that this version can run it.

    Args:
        metadata: metadata of the file.
        origin: name of the file, for messages.

    Raises:
        PolicyFileError: if an entry is missing, out of range, or different from what this version runs.
    """
    version = metadata.get("contract")
    if version != CONTRACT_VERSION:
        raise PolicyFileError(
            f"{origin} has contract version {version}, this hugwbc reads {CONTRACT_VERSION}; use the one that wrote it"
        )
    expected = policy_contract()
    expected["command"] += _expected_terms(metadata, origin)
    if metadata.get("robot") not in robot_names():
        raise PolicyFileError(
            f"{origin} has robot = {metadata.get('robot')}, this version of hugwbc knows {', '.join(robot_names())}; "
            "use a policy of one of them"
        )
    for key in _FIXED:
        if metadata.get(key) != expected[key]:
            raise PolicyFileError(
                f"{origin} has {key} = {metadata.get(key)}, this version of hugwbc runs {expected[key]}; "
                "use a policy trained with this version"
            )
    joints = len(expected["joint_names"])
    for key, (low, high) in _OWN_NUMBERS.items():
        _check_numbers(origin, key, [metadata.get(key)], 1, low, high)
    for key, (low, high) in _OWN_VECTORS.items():
        _check_numbers(origin, key, metadata.get(key), joints, low, high)
    return metadata


def _expected_terms(metadata: dict[str, Any], origin: object) -> list[dict[str, Any]]:
    """Return the layout of the terms of other packages that a file names, as these packages declare them here.

    Raises:
        PolicyFileError: if a term is not there, or does not work.
    """
    parts = metadata.get("command")
    own = [part for part in parts if isinstance(part, dict) and _TERM in part] if isinstance(parts, list) else []
    try:
        return _own_layout([str(part[_TERM]) for part in own])
    except UnknownNameError as error:
        names = ", ".join(str(part[_TERM]) for part in own)
        raise PolicyFileError(
            f"{origin} reads the observation terms {names} of other packages: {error} Install the package that it was "
            "trained with"
        ) from error
    except ConfigError as error:
        raise PolicyFileError(f"{origin} cannot run: {error}") from error


def recorded_intervention(metadata: dict[str, Any]) -> str | None:
    """Return what moved the arms in a policy's training ("noise", "motion" or "none"); None without a record."""
    record: Any = metadata
    for key in ("training", "config", "env", "intervention"):
        record = record.get(key) if isinstance(record, dict) else None
    return record if isinstance(record, str) else None


def _check_numbers(origin: object, key: str, values: object, count: int, low: float, high: float) -> None:
    numbers = values if isinstance(values, list) and len(values) == count else [math.nan]
    # NaN fails both comparisons. `type` rather than isinstance: Python counts bool as int, a contract does not.
    if not all(type(v) in (int, float) and low <= v <= high for v in numbers):
        raise PolicyFileError(
            f"{origin} has {key} = {values}; valid: {count} number(s) from {low:g} to {high:g}. "
            "Use a policy file as hugwbc wrote it"
        )
