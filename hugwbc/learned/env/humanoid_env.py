"""The training environment: many robots, their commands, interventions, rewards and resets; torch in, torch out."""

import functools
import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import torch

from hugwbc import gait as gaits
from hugwbc.commands import COMMAND_NAMES
from hugwbc.learned.config import EnvConfig
from hugwbc.learned.config.schedules import value_of
from hugwbc.learned.env import environment_state
from hugwbc.learned.env.arm_intervention import ArmGains, Intervention, make_arm_targets
from hugwbc.learned.env.curriculum import Curriculum, draw_commands, draw_gaits
from hugwbc.learned.env.loads import Loads
from hugwbc.learned.env.randomization import (
    Latency,
    SensorErrors,
    draw_delays,
    push,
    rand,
    randint,
    randomize,
    symmetric,
    uniform,
)
from hugwbc.learned.env.readings import (
    BIAS_TIME,
    Body,
    Readings,
    StepResult,
    Transition,
    feet_on_ground,
    has_fallen,
    read,
    tensor,
    to_heading,
)
from hugwbc.learned.env.rewards import check_terms, evaluate_terms, relative_tracking, reward_terms
from hugwbc.learned.env.rough_ground import RoughGround
from hugwbc.learned.env.running_statistics import Statistics
from hugwbc.learned.policy import critic_observations as obs
from hugwbc.learned.policy.critic_observations import Observation
from hugwbc.learned.policy.leg_feed_forward import CommandFeedForward
from hugwbc.learned.policy.terms import (
    COMMAND,
    ESTIMATE,
    FRAME,
    HISTORY_FRAMES,
    LENGTH_SCALE,
    PRIVILEGED,
    Sensed,
    further_terms,
    observe,
    size_of,
)
from hugwbc.robot import load_robot
from hugwbc.sim.arena import DRIVES
from hugwbc.sim.batch import BatchSimulation, RobotBatch
from hugwbc.sim.terrain import Ground

GENERATED_MOTIONS_SEED = 0
START_JOINT_NOISE = 0.1  # [rad], half-width at the start of an episode
START_VELOCITY = 0.3  # [m/s] and [rad/s], half-width of the pelvis' velocities at the start of an episode
LINK_CONTACT_FORCE = 2.0  # [N], above which the privileged observation flags a link
_F, _L, _H = (COMMAND_NAMES.index(name) for name in ("f", "l", "h"))
_ALL = slice(None)


class HumanoidEnv:
    """n robots in MuJoCo under the HugWBC training task.

    Attributes:
        config: the settings; `adopt` changes those that may change.
        ground: rough ground and the level of each robot; None on a plane.
        simulation: the robots.
        latency: joint targets on their way to the motors; None if targets act at once.
        readings: state of the robots after the last step.
        curriculum: levels of penalty, noise and speed.
        intervention: external control of the arms.
        statistics: running figures.
        command, gait, phase: commands (n, 8), gaits (n,) and common phases, in [0, 1), (n,).
        age: control steps since the start of the episode, shape (n,).
        actions: last three policy outputs, newest first, shape (3, n, joints).
        history: last five proprioceptive frames, oldest first, shape (n, 5, size).
        friction: sliding friction of each robot, shape (n,).
        further: observation terms besides the paper's.
        sensors: errors of the sensors.
        loads: what the robots carry and what pulls and pushes them.
        bias: errors of v_x, v_y and omega filtered over `BIAS_TIME`, shape (n, 3).
        mass: mass of each robot without its loads, relative to its description, shape (n,).
        body: constants of the robot.
        waist: joint target of the waist before the action is added [rad], shape (n,).
        posture: height [m] and pitch [rad] that the feed-forward of squats has reached, shape (n, 2).
        nominal_qpos: nominal stand at the origin, as in `RobotBatch.qpos`, shape (7 + joints,).
        action_scale: radians of joint target per unit of action, shape (joints,).
    """

    # Construction ---------------------------------------------------------------------------------------------------

    def __init__(self, config: EnvConfig, *, seed: int, threads: int, device: str = "cpu") -> None:
        """Build the robots and start all episodes, each at a random age so that resets do not coincide.

        Args:
            config: the settings.
            seed: seed of every random number of the environment.
            threads: threads of the simulation, on the processor.
            device: "cpu" for MuJoCo; a CUDA device, or "warp" for the processor again, for MuJoCo Warp.
        """
        self.config = config
        self.robot = load_robot(config.robot)
        self.count = config.count
        self.dt = config.period
        make, place = _engine(device, threads)
        self.generator = torch.Generator(place).manual_seed(seed)
        rough, rng = config.terrain.roughness > 0.0, np.random.default_rng(seed)
        self.ground = RoughGround(self.count, config.terrain, rng, place) if rough else None
        self.simulation = make(
            config.count,
            terrain=None if self.ground is None else self.ground.terrain,
            robot=self.robot,
            actuators=DRIVES[config.drives],
            ground=Ground.named(config.ground),
            timestep=config.timestep,
        )
        self.action_scale = tensor(config.action_scales(self.robot), place)
        damping = config.damping(self.robot) / self.robot.kd
        self.friction = tensor(randomize(self.simulation, config.randomization, rng, damping), place)
        delays = draw_delays(self.count, config.randomization.latency, config.timestep, rng)
        self.latency = None if delays is None else Latency(delays, config.substeps, self.simulation)
        self.nominal_qpos = self.simulation.tensor(self.simulation.nominal_qpos)
        self._pose = torch.tensor(self.robot.nominal, device=place)
        self.curriculum = Curriculum(config.curriculum, self.robot)
        self.agile = torch.arange(self.count, device=place) < round(config.curriculum.agile_fraction * self.count)
        self._intervenable = ~self.agile & (config.intervention != "none")
        targets = make_arm_targets(
            config.intervention,
            self.robot,
            self.count,
            motions=config.motions,
            motions_seed=GENERATED_MOTIONS_SEED,
            generator=self.generator,
            paired=config.noise_paired,
            period=self.dt,
        )
        self.intervention = Intervention(self._intervenable, config.flip_probability, targets, self.generator)
        self.arm_gains = ArmGains(self.simulation, self.robot)
        self.loads = Loads(self.simulation, self.robot, config.loads, ~self.agile, self.generator, self.dt)
        self.mass = tensor(self.simulation.expand("body_mass").sum(1) / self.robot.mass)
        seconds = np.zeros(self.count) if delays is None else delays * config.timestep
        self._body_facts = torch.stack((self.mass, tensor(seconds, place)), dim=1)
        self.adopt(config)
        self.body = Body.of(self.robot, self.dt, place)
        self.statistics = Statistics(self.agile, self.robot.waist)
        self.further = further_terms(config.observations, self.robot)
        self._further_noise = obs.noise_amplitude(self.further, self.robot).to(place)
        joints = len(self.robot.joint_names)
        self.sensors = SensorErrors(self.count, joints, config.randomization.sensing, self.generator)
        zeros = functools.partial(torch.zeros, device=place)
        self.command = zeros(self.count, len(COMMAND_NAMES))
        self.gait, self.age = zeros(2, self.count, dtype=torch.long)
        self.phase, self.waist = zeros(2, self.count)
        self.actions = zeros(3, self.count, joints)
        self.history = zeros(self.count, HISTORY_FRAMES, size_of(FRAME, self.robot))
        self.posture, self.bias = zeros(self.count, 2), zeros(self.count, 3)
        self.begin_episodes(torch.arange(self.count, device=place))
        nobody = zeros(self.count, dtype=torch.bool)
        check_terms(config.terms, self._transition(self.readings, nobody), self.body)
        self.age = randint(self.generator, config.episode_steps, self.count)

    @property
    def device(self) -> torch.device:
        """Device of all tensors."""
        return self.simulation.device

    def adopt(self, config: EnvConfig) -> None:
        """Continue with other settings of those in `config.environment.ADOPTED`; the rest must be as before."""
        self._given = config  # before the rules of the curriculum
        self.config = config = self.curriculum.applied(config)
        self._terms = reward_terms(config)
        self._commanded = CommandFeedForward(config.contract(), functools.partial(torch.as_tensor, device=self.device))
        self.curriculum.config = config.curriculum
        self.loads.config = config.loads

    # Stepping -------------------------------------------------------------------------------------------------------

    def step(self, action: torch.Tensor) -> StepResult:
        """Advance all robots by a control step with actions, shape (n, joints), and restart the episodes that ended."""
        self.actions = torch.stack((action, self.actions[0], self.actions[1]))
        previous = self.readings
        acting = self._outside()
        self._apply(action)
        self.loads.step(gaits.hopping(self.gait))
        disturbed = push(self.simulation, self.config.randomization, self.generator)
        disturbed |= (self._outside() != acting).any(1)
        if self.ground is not None:
            self.ground.keep_inside(self.simulation, self.readings.position[:, :2])
        late = self.latency
        diverged = self.simulation.step(self.config.substeps) if late is None else late.step()
        self.age += 1
        self.phase = gaits.advance_phase(self.phase, self.command[:, _F], self.dt)
        self.readings = read(self.simulation, self.ground)
        fallen = has_fallen(self.readings, self.robot) | diverged
        self._filter_errors()
        transition = self._transition(previous, fallen)
        rewards = evaluate_terms(self._terms, transition, self.body, self.curriculum.penalty_scale)
        # A diverged state may hold NaN, and so may a term of a user's: neither must reach the sums of the others.
        reward = torch.nan_to_num(torch.stack(tuple(rewards.values())), nan=0.0, posinf=0.0, neginf=0.0).sum(0)
        truncated = ~fallen & (self.age >= self.config.episode_steps)
        done = fallen | truncated
        tracking = relative_tracking(rewards, self._terms, self.dt)
        self.statistics.add(rewards, tracking, transition, self.age[done], diverged)
        self.history = torch.cat((self.history[:, 1:], self._frame()[:, None]), dim=1)
        ended = done.nonzero().squeeze(1)
        # Bootstrapping needs the state in which a time-out happened: observe it before the reset replaces it.
        final = self.observe(ended)
        due = (~done & (self.age % self.config.command.resample_steps == 0)).nonzero().squeeze(1)
        gait = self._draw_gaits(due)
        gait[self.loads.payload[due].any(1) & gaits.hopping(gait)] = gaits.Gait.WALKING  # nobody hops with a load
        self._draw_commands(due, gait)
        disturbed[due] = True
        if self.ground is not None:
            self.ground.advance(ended, fallen[ended], self.statistics.tracking[ended, 0])
        self.begin_episodes(ended)
        return StepResult(reward, fallen, truncated, final, disturbed)

    def _outside(self) -> torch.Tensor:
        """Return what acts on the robots besides their policy: forces, and external control of the arms."""
        forces = torch.cat((self.loads.hand_force.flatten(1), self.loads.trunk_force), 1)
        return torch.cat((forces, self.intervention.active[:, None].to(forces.dtype)), 1)

    def _apply(self, action: torch.Tensor) -> None:
        """Write the joint targets of a control step: action, feed-forward of commands, external control of the arms."""
        self.waist, posture = self._commanded.follow(self.waist, self.posture, self.command)
        self.posture = posture.float()
        offsets = self._commanded.offsets(self.waist, self.posture, self.phase, self.gait, self.command)
        target = self.body.nominal + self.action_scale * action + offsets.float()
        alpha = self.curriculum.alpha
        # The paper excludes hopping: it is too unstable for arms under external control.
        self.intervention.eligible = self._intervenable & ~gaits.hopping(self.gait)
        self.intervention.step()
        target[:, self.body.arms] = self.intervention.blend(target[:, self.body.arms], alpha)
        self.arm_gains.update(self.intervention.active * alpha)
        self.simulation.ctrl[:] = target

    def _filter_errors(self) -> None:
        """Add the velocity errors of this step to their running means."""
        r = self.readings
        error = torch.cat((r.velocity[:, :2], r.yaw_rate[:, None]), dim=1) - self.command[:, :3]
        self.bias = self.bias + self.dt / BIAS_TIME * (torch.nan_to_num(error) - self.bias)

    def _transition(self, previous: Readings, fallen: torch.Tensor) -> Transition:
        feet = gaits.foot_phases(self.phase, self.gait)
        return Transition(
            **vars(self.readings),
            command=self.command,
            gait=self.gait,
            bias=self.bias,
            action=self.actions[0],
            previous_action=self.actions[1],
            older_action=self.actions[2],
            previous_dq=previous.dq,
            touch_down=feet_on_ground(self.readings.foot_force) & ~feet_on_ground(previous.foot_force),
            descent=-previous.foot_velocity[..., 2],
            target_clearance=gaits.swing_height(feet, self.command[:, [_L]]),
            contact=gaits.expected_contact(feet),
            bounce=torch.stack(gaits.bounce(self.phase, self.gait, self.command[:, _F]), dim=1),
            in_phase=feet[:, 0] == feet[:, 1],
            intervention=self.intervention.active,
            fallen=fallen,
        )

    # Curricula ------------------------------------------------------------------------------------------------------

    def update_curriculum(self) -> None:
        """Move the curricula once, based on the tracking rewards of moving robots of both groups."""
        self.curriculum.update(
            self.statistics.gate("speed") if bool(self.agile.any()) else None,
            self.statistics.gate("alpha") if bool(self._intervenable.any()) else None,
        )
        if self.curriculum.config.rules:
            self.curriculum.apply_rules(self.config)
            self.adopt(self._given)
        if self.ground is not None:
            self.curriculum.gates["terrain"] = self.ground.report()

    @property
    def levels(self) -> dict[str, float]:
        """Present levels for the log, by name: that of the ground, and the settings that rules move."""
        ground = {} if self.ground is None else {"terrain_level": self.ground.mean_level}
        return ground | {f"rule/{name}": value_of(self.config, name) for name in self.config.curriculum.rules}

    def restore_levels(self, state: Mapping[str, Any]) -> None:
        """Restore the levels of the curricula alone: what `Curriculum.state_dict` returned."""
        self.curriculum.load_state_dict(state)
        self.statistics.set_gates(speed=self.curriculum.agile, alpha=self.curriculum.intervened)
        self.adopt(self._given)

    # Episodes -------------------------------------------------------------------------------------------------------

    def begin_episodes(self, robots: torch.Tensor) -> None:
        """Restart robots (indices): nominal pose with noise, random heading, new command."""
        count = robots.numel()
        if not count:
            return
        self._place(robots)
        # A gait keeps its share of the time, however early its episodes end. If gaits were drawn anew at each start,
        # hops that are not yet mastered would have 2 % of the time instead of 20 %.
        between = self.config.command.resample_steps
        lasted = (self.age[robots] - 1) % between + 1
        again = rand(self.generator, count) >= lasted / between
        self.age[robots] = 0
        self._draw_commands(robots, torch.where(again, self.gait[robots], self._draw_gaits(robots)))
        # Payloads change the model, so they are drawn before the quantities that depend on it are computed.
        self.loads.reset(robots, gaits.hopping(self.gait[robots]))
        self.simulation.forward(robots)
        self.phase[robots] = rand(self.generator, count)
        self.actions[:, robots] = 0.0
        self.waist[robots] = 0.0
        self.posture[robots] = 0.0
        self.intervention.reset(robots)
        self.sensors.reset(robots)
        self.readings = read(self.simulation, self.ground)
        self.history[robots] = self._frame()[robots, None]  # a stand has no past

    def _place(self, robots: torch.Tensor) -> None:
        """Let robots (indices) stand: nominal joints with noise, a random heading, a pelvis that moves.

        The joint targets, past ones included, are the joints' positions.
        """
        count, generator = robots.numel(), self.generator
        yaw = uniform(generator, count, -math.pi, math.pi)
        qpos = self.nominal_qpos.repeat(count, 1)
        qpos[:, 3], qpos[:, 6] = torch.cos(yaw.double() / 2.0), torch.sin(yaw.double() / 2.0)
        target = qpos[:, 7:]
        target += START_JOINT_NOISE * symmetric(generator, *target.shape)
        if self.ground is not None:
            qpos[:, :3] += self.ground.starts(robots, yaw, rand(generator, count, 2))
        simulation = self.simulation
        simulation.qpos[robots], simulation.ctrl[robots], simulation.qvel[robots] = qpos, target, 0.0
        simulation.qvel[robots, :6] = simulation.tensor(START_VELOCITY * symmetric(generator, count, 6))
        if self.latency is not None:
            self.latency.reset(robots, target)

    def _draw_gaits(self, robots: torch.Tensor) -> torch.Tensor:
        return draw_gaits(robots.numel(), self.config.command, self.generator)

    def _draw_commands(self, robots: torch.Tensor, gait: torch.Tensor) -> None:
        """Give robots (indices) new gaits, both of shape (k,), and draw commands for them."""
        if robots.numel():
            self.gait[robots] = gait
            told = self.config.command, self.curriculum, self.generator
            self.command[robots] = draw_commands(gait, self.agile[robots], *told)
            self.bias[robots] = 0.0

    # Observations ---------------------------------------------------------------------------------------------------

    def _frame(self) -> torch.Tensor:
        """Return the proprioceptive frame of the current state with new errors of the sensors, shape (n, size)."""
        r = self.sensors.sensed(self.readings)
        sensed = (r.angular_velocity, r.gravity, r.q, r.dq, self.actions[0])
        return observe(FRAME, self._sensed(_ALL, *sensed))

    def observe(self, robots: torch.Tensor | slice = _ALL) -> Observation:
        """Return the observations of the current state, of all robots or of some (indices)."""
        r = self.readings
        history = self.history[robots].flatten(1)
        sensed = self._sensed(robots, *obs.in_units(self.history[robots, -1], self._pose, self.robot))
        command = observe(COMMAND, sensed)
        # In most steps no episode ends, and this is called for no robot: a user's term need not handle that.
        further = observe(self.further, sensed) if len(command) else self._further_noise.expand(0, -1)
        if any(term.noise for term in self.further):
            further += symmetric(self.generator, *further.shape) * self._further_noise
        velocity, height, clearance = r.velocity[robots], r.height[robots], r.clearance[robots]
        mass, latency = self._body_facts[robots].unbind(1)
        privileged = obs.side_by_side(
            PRIVILEGED,
            velocity,
            (height - self.command[robots, _H])[:, None],
            clearance,
            self.friction[robots, None],
            to_heading(r.foot_force[robots], r.heading[robots, None]).flatten(1),
            (r.link_force[robots] > LINK_CONTACT_FORCE).to(velocity.dtype),
            self.bias[robots],
            *self.loads.observation(r.heading)[robots].split((2, 6, 3), 1),
            mass[:, None] - 1.0,
            latency[:, None],
        )
        if self.ground is None:  # all samples of a plane are equal, and there is one column
            terrain = (height * LENGTH_SCALE)[:, None]
        else:
            terrain = self.ground.depths(r.position[robots], r.heading[robots], self.robot.nominal_height)
        critic = torch.cat((history[:, -self.history.shape[2] :], command, privileged, further, terrain), dim=1)
        estimate = obs.side_by_side(ESTIMATE, velocity, clearance, height[:, None])
        return Observation(history, torch.cat((command, further), 1), critic, estimate)

    def _sensed(self, robots: torch.Tensor | slice, *frame: torch.Tensor) -> Sensed:
        """Return what robots (all, or indices) sense, given in the order of `terms.FRAME`, and are told."""
        told = (self.command, self.gait, self.phase, self.intervention.active)
        return Sensed(*frame, *(value[robots] for value in told), pose=self._pose)

    # Checkpointing --------------------------------------------------------------------------------------------------

    state_dict = environment_state.state_of
    load_state_dict = environment_state.restore


def _engine(device: str, threads: int) -> tuple[Callable[..., RobotBatch], torch.device]:
    """Return the maker of the robots for the `device` of `HumanoidEnv`, and the device of their tensors."""
    if device == "cpu":
        return functools.partial(BatchSimulation, threads=threads), torch.device("cpu")
    from hugwbc.sim.warp_batch import WarpBatch

    place = torch.device("cpu" if device == "warp" else device)
    return functools.partial(WarpBatch, device=str(place)), place
