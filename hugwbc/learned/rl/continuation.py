"""What a run finds in the checkpoint that it goes on from: whether it may, and what it then begins with."""

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
OF_A_SESSION = ("resume", "hours", "threads", "device", "save_interval")  # settings without which a run is the same
# Settings of the environment without which a policy moves differently: its clock, its drives and its feed-forward.
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
_MOST_NAMED = 5  # settings in an error


@contextlib.contextmanager
def readable(path: pathlib.Path) -> Iterator[None]:
    """Refuse metadata that lacks something or holds something else."""
    try:
        yield
    except (KeyError, TypeError, ValueError) as error:
        raise PolicyFileError(
            f"{path} lacks a readable {error} in its metadata; use a checkpoint as hugwbc wrote it"
        ) from error


def by_group(tensors: dict[str, torch.Tensor], path: pathlib.Path) -> dict[str, dict[str, torch.Tensor]]:
    """Sort the tensors of a checkpoint into networks, environment and optimiser, by the names used there."""
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
    """Refuse to go on with other settings than a checkpoint's, but for those of a session."""
    with readable(path):
        before, now = (_flat(settings) for settings in (metadata["config"], settings_record(config)))
    # A setting that one of the two lacks is of another version, unless its name is the user's.
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
    """Refuse networks that read other terms besides the paper's; those that read none get inputs for them."""
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
    """Return what a user should know: another clock, other drives or another feed-forward than in a checkpoint."""
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
    """Replace the first process's robots in a checkpoint by this process's; drop them if there are none."""
    common = {name: value for name, value in tensors.items() if name.startswith(("network.", "product.", "optimiser."))}
    place = distributed.rank_path(path)
    if not place.exists():
        return common
    robots, metadata = checkpoint.load_file(place, "robots")
    # A file of another iteration comes from an earlier time or run in the same folder: start new episodes instead.
    return common | robots if metadata.get("iteration") == iteration else common
