"""What the robots of a training environment show to actor and critic."""

from typing import TYPE_CHECKING

import torch

from hugwbc import gait as gaits
from hugwbc.commands import COMMAND_NAMES
from hugwbc.learned.policy import observations as obs
from hugwbc.learned.policy.observations import Observation

if TYPE_CHECKING:
    from hugwbc.learned.env.humanoid_env import HumanoidEnv

LINK_CONTACT_FORCE = 2.0  # [N], above which the privileged observation flags a link
_H = COMMAND_NAMES.index("h")


def frame(env: "HumanoidEnv") -> torch.Tensor:
    """The proprioceptive frame of the current state, with new noise, shape (n, 63)."""
    r = env.readings
    exact = obs.proprioception(r.angular_velocity, r.gravity, r.q - env.body.nominal, r.dq, env.actions[0])
    noise = 2.0 * torch.rand(exact.shape, generator=env.generator) - 1.0
    return exact + noise * env.noise


def observe(env: "HumanoidEnv", robots: torch.Tensor | slice) -> Observation:
    """Observations of the current state, of some robots (indices)."""
    r = env.readings
    history = env.history[robots].flatten(1)
    clock = gaits.clock(env.bar_phase()[robots])
    active = env.intervention.active[robots]
    command = obs.command_observation(env.command[robots], env.gait[robots], clock, active)
    velocity, height, clearance = r.velocity[robots], r.height[robots], r.clearance[robots]
    privileged = obs.privileged(
        velocity,
        height - env.command[robots, _H],
        clearance,
        env.friction[robots],
        r.foot_force[robots],
        r.link_force[robots] > LINK_CONTACT_FORCE,
    )
    terrain = _terrain_samples(env, height, robots)
    critic = torch.cat((history[:, -obs.PROPRIOCEPTION_SIZE :], command, privileged, terrain), dim=1)
    return Observation(history, command, critic, obs.estimate_target(velocity, clearance, height))


def _terrain_samples(env: "HumanoidEnv", height: torch.Tensor, robots: torch.Tensor | slice) -> torch.Tensor:
    """How far the ground around the robots lies below their pelvises, minus the nominal height, scaled."""
    if env.ground is None:  # every sample lies the same distance below
        return (height * obs.LENGTH_SCALE)[:, None].expand(-1, obs.TERRAIN_SIZE)
    position = env.readings.position[robots]
    ground = env.ground.samples(position[:, :2], env.readings.heading[robots])
    below = position[:, 2:] - env.robot.nominal_height - ground
    return below.clamp(-1.0, 1.0) * obs.LENGTH_SCALE
