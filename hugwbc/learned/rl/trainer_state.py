"""What a checkpoint holds of a training run, and how the run goes on from it."""

import pathlib
from typing import TYPE_CHECKING, Any

import torch

from hugwbc.errors import PolicyFileError
from hugwbc.learned import distributed
from hugwbc.learned.policy import checkpoint
from hugwbc.learned.policy.policy_contract import settings_record, versions
from hugwbc.learned.rl.ppo import PPO

if TYPE_CHECKING:
    from hugwbc.learned.rl.trainer import Trainer


def learner_of(trainer: "Trainer") -> dict[str, torch.Tensor]:
    """The part of a checkpoint that all processes have in common: networks and optimiser."""
    tensors = {f"network.{k}": v for k, v in trainer.ppo.network.state_dict().items()}
    for index, state in trainer.ppo.optimiser.state_dict()["state"].items():
        tensors |= {f"optimiser.{index}.{k}": v for k, v in state.items()}
    return tensors


def robots_of(trainer: "Trainer") -> dict[str, torch.Tensor]:
    """The part of a checkpoint that is this process's own."""
    robots = {f"env.{name}": value for name, value in trainer.env.state_dict().items()}
    return robots | {"generator": trainer.generator.get_state()}


def metadata_of(trainer: "Trainer") -> dict[str, Any]:
    """What a checkpoint, a snapshot and a policy say of their training, as JSON can hold it."""
    return {
        "iteration": trainer.iteration,
        "steps": trainer.steps,
        "seconds": trainer.seconds,
        "learning_rate": trainer.ppo.learning_rate,
        "skipped": trainer.ppo.skipped,
        "curriculum": trainer.env.curriculum.state_dict(),
        "evaluation": trainer.evaluation,
        "best": trainer.best,
        "versions": versions(),
        "config": settings_record(trainer.config),
    }


def restore(trainer: "Trainer", path: pathlib.Path) -> None:
    """Continue from a checkpoint, or from a snapshot: episodes and optimiser moments then start anew.

    Raises:
        PolicyFileError: if the file cannot be used, or holds another number of robots.
    """
    tensors, metadata = checkpoint.load_file(path, "checkpoint")
    if not trainer.leads:
        tensors = _with_own_robots(tensors, path, metadata.get("iteration"))
    groups = _by_group(tensors, path)
    try:
        trainer.ppo.network.load_state_dict(groups["network"])
    except RuntimeError as error:
        raise PolicyFileError(f"{path} has other networks than this version: {error}") from error
    if groups["env"]:
        try:
            stored, count = len(groups["env"]["command"]), trainer.config.env.count
            if stored == count:
                trainer.env.load_state_dict(groups["env"])
                trainer.generator.set_state(tensors["generator"])
        except (KeyError, TypeError, ValueError, RuntimeError) as error:
            raise PolicyFileError(
                f"{path} does not hold the environment's state as this version has it ({error}); it was written "
                "by another one. Continue from its snapshot instead"
            ) from error
        if stored != count:
            raise PolicyFileError(
                f"{path} holds {stored} robots, the configuration asks for {count}; pass --env.count {stored}"
            )
    if groups["optimiser"]:
        _restore_optimiser(trainer.ppo, groups["optimiser"])
    try:
        if not groups["env"]:
            trainer.env.curriculum.load_state_dict(metadata["curriculum"])
        _restore_counters(trainer, metadata)
    except (KeyError, TypeError, ValueError) as error:
        raise PolicyFileError(
            f"{path} lacks a readable {error} in its metadata; use a checkpoint as hugwbc wrote it"
        ) from error
    trainer.ppo.bound_std(trainer.steps)


def _by_group(tensors: dict[str, torch.Tensor], path: pathlib.Path) -> dict[str, dict[str, torch.Tensor]]:
    """The tensors of networks, environment and optimiser, by the names that they have there."""
    groups: dict[str, dict[str, torch.Tensor]] = {"network": {}, "env": {}, "optimiser": {}}
    for key, value in tensors.items():
        group, _, name = key.partition(".")
        if not name:
            continue  # the generator
        if group not in groups:
            raise PolicyFileError(
                f"{path} holds {group!r}, this version reads {', '.join(groups)}; it was written by another one"
            )
        groups[group][name] = value
    return groups


def _restore_counters(trainer: "Trainer", metadata: dict[str, Any]) -> None:
    trainer.iteration, trainer.steps = int(metadata["iteration"]), int(metadata["steps"])
    trainer.seconds = float(metadata["seconds"])
    trainer.ppo.set_learning_rate(float(metadata["learning_rate"]))
    trainer.ppo.skipped = int(metadata["skipped"])
    # Checkpoints from before there were evaluations lack these two.
    trainer.evaluation, trainer.best = dict(metadata.get("evaluation", {})), dict(metadata.get("best", {}))


def _restore_optimiser(ppo: PPO, tensors: dict[str, torch.Tensor]) -> None:
    state: dict[int, dict[str, torch.Tensor]] = {}
    for key, value in tensors.items():
        index, _, name = key.partition(".")
        state.setdefault(int(index), {})[name] = value.clone()
    ppo.optimiser.load_state_dict({"state": state, "param_groups": ppo.optimiser.state_dict()["param_groups"]})


def _with_own_robots(
    tensors: dict[str, torch.Tensor], path: pathlib.Path, iteration: object
) -> dict[str, torch.Tensor]:
    """A checkpoint with this process's robots instead of the first one's; without any if there are none to it."""
    common = {name: value for name, value in tensors.items() if name.startswith(("network.", "optimiser."))}
    own = distributed.own_path(path)
    if not own.exists():
        return common
    robots, metadata = checkpoint.load_file(own, "robots")
    # From another time of the run, or of a run before it in the same folder: start new episodes.
    return common | robots if metadata.get("iteration") == iteration else common
