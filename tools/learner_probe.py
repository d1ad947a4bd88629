"""Three looks at a training snapshot: how exactly it walks, how much of the actor's gradient is signal, what it misses.

1. Walks without exploration, disturbances or loads: reward a second, and the errors of v_x, v_y and omega as bias, part
   that repeats with the stride, and rest.
2. The cosine between the actor's gradients of two batches of the learner. 1 is all signal, 0 all noise.
3. The slope of the reward along two directions that are known to be worth something, more of the commanded v_x and of
   omega: as the gradient sees it, and as a difference of two rollouts.

    python tools/learner_probe.py models/h1/policies/h1/snapshot.safetensors
"""

import argparse
import dataclasses
import math
import pathlib
from collections.abc import Mapping
from typing import Any

import torch

from hugwbc.commands import COMMAND_NAMES, command_ranges
from hugwbc.gait import Gait
from hugwbc.learned import distributed
from hugwbc.learned.config import EnvConfig, LoadConfig, PPOConfig
from hugwbc.learned.env.humanoid_env import HumanoidEnv
from hugwbc.learned.policy import checkpoint
from hugwbc.learned.policy.networks import load_into
from hugwbc.learned.policy.terms import COMMAND
from hugwbc.learned.rl.ppo import PPO, Rollout, generalised_advantage, log_probability

V_X, OMEGA = COMMAND_NAMES.index("v_x"), COMMAND_NAMES.index("omega")
NEVER = 2**30  # control steps
WALKS = {"v_x": (-0.4, 0.25, 0.5, 0.75, 1.0, 1.3), "v_y": (0.2, 0.45), "omega": (0.3, 0.6), "l": (0.1, 0.22)}
SETTLE, BINS, CHUNK = 100, 25, 8192  # [control steps], parts of a stride, samples of a pass


class Subject:
    """A snapshot: its levels, the settings it was trained with, and learners that start from it."""

    def __init__(self, path: pathlib.Path, std: float, starts: pathlib.Path | None) -> None:
        """Read a snapshot; explore with `std`, and start a share of the episodes from a file of recorded motion."""
        tensors, self.metadata = checkpoint.load_file(path, "checkpoint")
        self.network = {name.removeprefix("network."): value for name, value in tensors.items()}
        recorded = {name: dict(self.metadata["config"][name]) for name in ("env", "ppo")}
        self.env: EnvConfig = dataclasses.replace(_with(EnvConfig(), recorded["env"]), starts=starts)
        self.ppo: PPOConfig = dataclasses.replace(_with(PPOConfig(), recorded["ppo"]), std_limit=std)
        self.std = std

    def learner(self, env: HumanoidEnv, horizon: int, seed: int) -> PPO:
        """Return a learner with the snapshot's networks for iterations of `horizon` steps."""
        settings = dataclasses.replace(self.ppo, horizon=horizon)
        ppo = PPO(settings, env.robot, torch.Generator().manual_seed(seed), further=env.further)
        load_into(ppo.network, self.network)
        with torch.no_grad():
            ppo.network.log_std.fill_(math.log(self.std))
        return ppo

    def robots(self, config: EnvConfig, seed: int) -> HumanoidEnv:
        """Return an environment at the snapshot's levels of the curricula."""
        env = HumanoidEnv(config, seed=seed, threads=1)
        env.restore_levels(self.metadata["curriculum"])
        return env


def _with(settings: Any, record: Mapping[str, Any]) -> Any:  # noqa: ANN401  any dataclass of settings
    """Return settings with the values of a snapshot's record; settings that are gone since are left out."""
    changes = {}
    for field in dataclasses.fields(settings):
        if field.name in record:
            old, value = getattr(settings, field.name), record[field.name]
            if dataclasses.is_dataclass(old):
                value = _with(old, value)
            changes[field.name] = tuple(value) if isinstance(value, list) else value
    return dataclasses.replace(settings, **changes)


def undisturbed(config: EnvConfig) -> EnvConfig:
    """Return settings without pushes, loads and intervention."""
    calm = dataclasses.replace(config.randomization, push_velocity=0.0)
    return dataclasses.replace(config, randomization=calm, loads=LoadConfig(), intervention="none")


# Walks ---------------------------------------------------------------------------------------------------------------


@torch.no_grad()
def walks(subject: Subject, each: int, seconds: float) -> None:
    """Print a line for each command, walked by `each` robots without exploration."""
    cells = [(name, value) for name, values in WALKS.items() for value in values]
    forever = dataclasses.replace(subject.env.command, resample_steps=NEVER)
    flat = dataclasses.replace(subject.env.terrain, roughness=0.0)
    config = dataclasses.replace(
        undisturbed(subject.env),
        count=each * len(cells),
        command=forever,
        terrain=flat,
        episode_steps=NEVER,
        starts=None,
    )
    env = subject.robots(config, seed=77)
    env.age.zero_()
    env.gait[:] = Gait.WALKING
    env.command[:] = torch.tensor([limits.default for limits in command_ranges(Gait.WALKING).values()])
    for cell, (name, value) in enumerate(cells):
        robots = slice(cell * each, (cell + 1) * each)
        env.command[robots, V_X] = 0.4 if name == "l" else 0.0
        env.command[robots, COMMAND_NAMES.index(name)] = value
    command, actor = env.command.clone(), subject.learner(env, 1, seed=0).network.actor.plain()
    upright = torch.ones(env.count, dtype=torch.bool)
    errors, rewards, phases = [], [], []
    for step in range(round(seconds / env.dt)):
        observation = env.observe()
        result = env.step(actor(observation.history, observation.command)[0])
        upright &= ~result.done
        if step >= SETTLE:
            r = env.readings
            errors.append(torch.cat((r.velocity[:, :2], r.yaw_rate[:, None]), 1) - command[:, :3])
            rewards.append(result.reward / env.dt)
            phases.append(env.phase.clone())
    error, reward = torch.stack(errors), torch.stack(rewards)
    bias, stride, rest = _parts(error, torch.stack(phases))
    print("noise-free walks: bias of v_x, v_y, omega | repeats with the stride (RMS) | rest (RMS)")
    for cell, (name, value) in enumerate([*cells, ("all", 0.0)]):
        robots = upright.clone() if name == "all" else upright & (torch.arange(env.count) // each == cell)
        figures = (bias[robots].mean(0), stride[robots].mean(0), rest[robots].mean(0))
        text = " | ".join(" ".join(f"{number:+.3f}" for number in figure.tolist()) for figure in figures)
        print(
            f"  {name:5s} {value:+.2f}: {int(robots.sum()):3d} upright, reward {reward[:, robots].mean():.3f}/s, {text}"
        )


def _parts(error: torch.Tensor, phase: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Return mean, spread of the mean over the stride, and spread about it of errors (t, n, 3), shape (n, 3) each."""
    mean = error.mean(0)
    part = torch.nn.functional.one_hot((phase * BINS).long().clamp(0, BINS - 1), BINS).to(error.dtype)  # (t, n, bins)
    share = part.mean(0)
    profile = torch.einsum("tnb,tnk->nbk", part, error) / (len(error) * share).clamp(min=1.0)[..., None]
    stride = (share[..., None] * (profile - mean[:, None]).square()).sum(1)
    rest = (error.square().mean(0) - mean.square() - stride).clamp(min=0.0)
    return mean, stride.sqrt(), rest.sqrt()


# Gradients -----------------------------------------------------------------------------------------------------------


@torch.no_grad()
def experience(
    subject: Subject, config: EnvConfig, steps: int, gain: Mapping[int, float] | None = None
) -> tuple[PPO, torch.Tensor, torch.Tensor]:
    """Return a learner with `steps` steps of experience, the value after them, and the commands, shape (steps, n, 8).

    Args:
        subject: the snapshot.
        config: settings of the environment.
        steps: control steps; as many as half of them go before and do not count.
        gain: by how much more of a command, by its column, walking robots are asked for than their rewards ask.
    """
    env = subject.robots(config, seed=5)
    ppo, commands = subject.learner(env, steps, seed=5), []
    for step in range(-(steps // 2), steps):
        seen = env.observe()
        asked = torch.zeros_like(seen.command)
        for column, more in (gain or {}).items():
            asked[:, column] = more * seen.command[:, column] * (env.gait == Gait.WALKING)
        seen = dataclasses.replace(seen, command=seen.command + asked)
        action = ppo.act(max(step, 0), seen, env.gait)
        commands.append(env.command.clone())
        ppo.record(max(step, 0), env.step(action))
    return ppo, ppo.value(env.observe().critic), torch.stack(commands[-steps:])


def advantages(ppo: PPO, last: torch.Tensor) -> torch.Tensor:
    """Return the advantages of a learner's experience, shape (t, n)."""
    r, c = ppo.rollout, ppo.config
    return generalised_advantage(r.reward, r.done, r.disturbed, r.value, last, c.gamma, c.lam)


def cosines(ppo: PPO, advantage: torch.Tensor, batch: int) -> None:
    """Print the cosine between the actor's gradients of independent batches, for all gaits and for each alone."""
    r = ppo.rollout
    windows = torch.arange(len(r.reward)).split(max(1, batch // r.reward.shape[1]))
    windows = [window for window in windows if len(window) == len(windows[0])]
    size = len(windows[0]) * r.reward.shape[1]
    print(f"cosine between the actor's gradients of two batches of {size}, 4, 16 and 64 times as many samples:")
    for label, group in {"all": None, "walking": 1, "standing": 0, "jumping": 2, "hopping": 3}.items():
        gradients = torch.stack([_gradient(ppo, r, advantage, window, group) for window in windows])
        gram, k = gradients @ gradients.T, len(windows)
        signal = (gram.sum() - gram.trace()) / (k * (k - 1))
        total, spread = gram.trace() / k, gram[~torch.eye(k, dtype=torch.bool)].std() / math.sqrt(k * (k - 1) / 2)
        larger = " ".join(f"{float(signal / (signal + (total - signal) / n)):.3f}" for n in (4, 16, 64) if signal > 0)
        print(f"  {label:9s} {float(signal / total):+.4f} +- {float(spread / total):.4f}, {larger or 'no signal'}")


def _gradient(ppo: PPO, r: Rollout, advantage: torch.Tensor, window: torch.Tensor, group: int | None) -> torch.Tensor:
    """Return the gradient of the surrogate by the weights of the policy, of the samples of a group of gaits."""
    weights = [*ppo.network.actor.encoder.parameters(), *ppo.network.actor.policy.parameters()]
    groups = r.group[window].flatten()
    scaled = distributed.standardised(advantage[window].flatten(), groups, len(Gait))
    chosen = torch.ones_like(groups, dtype=torch.bool) if group is None else groups == group
    history, command, action = (value[window].flatten(0, 1)[chosen] for value in (r.history, r.command, r.action))
    total = torch.zeros(sum(weight.numel() for weight in weights))
    for rows in torch.arange(int(chosen.sum())).split(CHUNK):
        mean, _ = ppo.network.actor.prepared(history[rows], command[rows])
        log_prob = log_probability(action[rows], mean, ppo.network.exploration().detach())
        surrogate = (log_prob * scaled[chosen][rows]).sum() / len(scaled)
        total += torch.cat([gradient.flatten() for gradient in torch.autograd.grad(surrogate, weights)])
    return total


@torch.no_grad()
def slope(ppo: PPO, advantage: torch.Tensor, commands: torch.Tensor, column: int) -> tuple[float, float]:
    """Return d(reward of a step) / d(gain of a command) of walking robots by the policy gradient, and its spread.

    Args:
        ppo: learner with experience.
        advantage: its advantages, shape (t, n).
        commands: the commands, shape (t, n, 8).
        column: which of them is multiplied by 1 + gain.
    """
    r, step = ppo.rollout, 0.05
    walking = r.group == int(Gait.WALKING)
    coordinates = ppo.network.actor._command
    more = torch.zeros(*commands.shape[:2], len(coordinates.matrix))
    more[..., column] = step * commands[..., column] * torch.tensor(COMMAND[0].scale)[column]
    change = coordinates(more.flatten(0, 1)).view_as(more)
    log_std = ppo.network.exploration()
    moves = [
        torch.stack([ppo.network.actor.prepared(h, c)[0] for h, c in zip(r.history, r.command + side, strict=True)])
        for side in (change, -change)
    ]
    score = ((r.action - r.mean) * (moves[0] - moves[1]) / (2.0 * step) / (2.0 * log_std).exp()).sum(2)
    each = (advantage - advantage[walking].mean()) * score * walking
    mean = each.sum() / walking.sum()
    # Steps of a robot hang together, robots do not.
    spread = (each.sum(0) - mean * walking.sum(0)).square().sum().sqrt() / walking.sum()
    return float(mean), float(spread)


def main() -> None:
    """Run the three looks."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("snapshot", type=pathlib.Path)
    parser.add_argument("--starts", type=pathlib.Path, help="recorded motion in which a share of the episodes starts")
    parser.add_argument("--std", type=float, default=0.1, help="exploration (.1)")
    parser.add_argument("--robots", type=int, default=512, help="robots of the gradient's experience (512)")
    parser.add_argument("--steps", type=int, default=480, help="their control steps (480); 0 for the walks alone")
    parser.add_argument("--batch", type=int, default=24_576, help="samples of a batch (24,576)")
    parser.add_argument("--gain", type=float, default=0.12, help="gain of the differences (.12); 0 for none")
    parser.add_argument("--undisturbed", action="store_true", help="experience without pushes, loads, intervention")
    parser.add_argument("--each", type=int, default=12, help="robots of each walk (12); 0 for no walks")
    chosen = parser.parse_args()
    torch.set_num_threads(1)
    subject = Subject(chosen.snapshot, chosen.std, chosen.starts)
    if chosen.each:
        walks(subject, chosen.each, seconds=8.0)
    if not chosen.steps:
        return
    config = dataclasses.replace(undisturbed(subject.env) if chosen.undisturbed else subject.env, count=chosen.robots)
    ppo, last, commands = experience(subject, config, chosen.steps)
    advantage = advantages(ppo, last)
    walking = ppo.rollout.group == int(Gait.WALKING)
    before, spread = float(ppo.rollout.reward[walking].mean()), float(advantage[walking].std())
    print(f"walking in training: reward {before / config.period:.3f}/s, spread of the advantages {spread:.3f}")
    cosines(ppo, advantage, chosen.batch)
    print("slope of the walking reward of a step along a gain of the command: by the gradient, by the difference")
    for name, column in (("v_x", V_X), ("omega", OMEGA)):
        line = "  {:5s} {:+.4f} +- {:.4f}".format(name, *slope(ppo, advantage, commands, column))
        if chosen.gain:
            other, _, _ = experience(subject, config, chosen.steps, {column: chosen.gain})
            after = float(other.rollout.reward[other.rollout.group == int(Gait.WALKING)].mean())
            line += f", {(after - before) / chosen.gain:+.4f}"
        print(line)


if __name__ == "__main__":
    main()
