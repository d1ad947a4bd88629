"""Checks of the checkpoint from which a run continues or starts, and what the run takes from it."""

import contextlib
import json
import pathlib
from collections.abc import Iterator
from typing import Any

import torch

from hugwbc.errors import ConfigError, PolicyFileError
from hugwbc.files import digest
from hugwbc.learned import distributed
from hugwbc.learned.config import EnvConfig, Schedule, TrainConfig
from hugwbc.learned.env.curriculum import RULE
from hugwbc.learned.policy import checkpoint
from hugwbc.learned.policy.network_files import SNAPSHOT_FILE
from hugwbc.learned.policy.records import settings_record
from hugwbc.robot_tables import robot_table

_NAMED = ("schedules.", "env.terms.", "env.curriculum.rules.")
OF_A_SESSION = ("resume", "hours", "threads", "device", "save_interval")  # may differ between sessions of a run
# Settings of the environment with which a policy moves differently: control period, PD targets and gains, feed-forward.
_OF_THE_MOTION = (
    "action_scale",
    "squat_gain",
    "substeps",
    "swing_gain",
    "timestep",
    "waist_rate",
    "yaw_action_factor",
    "yaw_damping_factor",
)
_MOST_NAMED = 5  # settings that an error names at most


@contextlib.contextmanager
def readable(path: pathlib.Path) -> Iterator[None]:
    """Raise PolicyFileError where metadata lack a field or hold something else than is read of them."""
    try:
        yield
    except (KeyError, TypeError, ValueError) as error:
        raise PolicyFileError(
            f"{path} lacks a readable {error} in its metadata; use a checkpoint as hugwbc wrote it"
        ) from error


def by_group(tensors: dict[str, torch.Tensor], path: pathlib.Path) -> dict[str, dict[str, torch.Tensor]]:
    """Return the tensors of a checkpoint as network, product, environment and optimiser, by the names used there."""
    groups: dict[str, dict[str, torch.Tensor]] = {"network": {}, "product": {}, "env": {}, "optimiser": {}}
    for key, value in tensors.items():
        group, _, name = key.partition(".")
        if not name:
            continue  # the generator
        if group not in groups:
            raise PolicyFileError(
                f"{path} holds {group!r}, this version reads {', '.join(groups)}; it was written by another version. "
                "Use a checkpoint or a snapshot of this one"
            )
        groups[group][name] = value
    return groups


def robot_digest(config: TrainConfig) -> str:
    """Return a digest of the table of the robot that is trained."""
    return digest(json.dumps(robot_table(config.env.robot), sort_keys=True))


def check_unchanged(metadata: dict[str, Any], config: TrainConfig, path: pathlib.Path) -> None:
    """Refuse to go on with other settings than a checkpoint's, except `OF_A_SESSION`, start_from and steps."""
    with readable(path):
        before, now = (_flat(settings) for settings in (metadata["config"], settings_record(config)))
    # A setting that only one of the two has is of another version, unless a user gave it its name.
    names = [name for name in before | now if name in before.keys() & now.keys() or name.startswith(_NAMED)]
    changed = [
        f"{name} {before.get(name, 'nothing')} (here {now.get(name, 'nothing')})"
        for name in names
        if name not in (*OF_A_SESSION, "start_from", "steps") and before.get(name) != now.get(name)
    ]
    robot = robot_digest(config)
    if metadata.get("robot", robot) != robot:
        changed.append(f"another content of the table of {config.env.robot}")
    if changed:
        more = f", and {len(changed) - _MOST_NAMED} others" if len(changed) > _MOST_NAMED else ""
        raise ConfigError(
            f"{path} was trained with {', '.join(changed[:_MOST_NAMED])}{more}. Give the same options again, or begin "
            f"another run with its policy: --start-from {path.with_name(SNAPSHOT_FILE)} and another --out"
        )


def check_observations(metadata: dict[str, Any], env: EnvConfig, path: pathlib.Path) -> None:
    """Refuse networks that read other further terms than `env` names; those that read none get inputs for them."""
    with readable(path):
        before, now = (
            ", ".join(names) for names in (metadata["config"]["env"].get("observations", ()), env.observations)
        )
    if before and before != now:
        raise ConfigError(
            f"{path} reads {before} besides the paper's terms, and env.observations names {now or 'none'}; name the "
            "same, or start from a snapshot that reads none"
        )


def _flat(settings: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return nested settings by dotted name, such as env.count."""
    found: dict[str, Any] = {}
    for name, value in settings.items():
        found |= _flat(value, f"{prefix}{name}.") if isinstance(value, dict) else {f"{prefix}{name}": value}
    return found


def differences(metadata: dict[str, Any], env: EnvConfig, path: pathlib.Path) -> str:
    """Return in words which settings of `_OF_THE_MOTION` differ from a checkpoint's; empty if none."""
    settings = metadata["config"]
    before: dict[str, float] = {}
    for name in settings["env"].keys() & _OF_THE_MOTION:
        schedule = settings.get("schedules", {}).get(f"env.{name}")
        ran = metadata["steps"] - metadata.get("begin", {}).get("steps", 0)
        given = settings["env"][name] if schedule is None else Schedule(**schedule).at(ran)
        before[name] = metadata.get("curriculum", {}).get(f"{RULE}{name}", given)
    words = [f"--env.{n.replace('_', '-')} {g:g}" for n, g in sorted(before.items()) if g != getattr(env, n)]
    return f"{path} was trained with {' '.join(words)}; without that it moves differently" if words else ""


def with_robots_of_rank(
    tensors: dict[str, torch.Tensor], path: pathlib.Path, iteration: object
) -> dict[str, torch.Tensor]:
    """Replace the robots of the first process in a checkpoint by those of this process; drop them if it has none."""
    common = {name: value for name, value in tensors.items() if name.startswith(("network.", "product.", "optimiser."))}
    place = distributed.rank_path(path)
    if not place.exists():
        return common
    robots, metadata = checkpoint.load_file(place, "robots")
    # A file of another iteration comes from an earlier time or run in the same folder: start new episodes instead.
    return common | robots if metadata.get("iteration") == iteration else common
