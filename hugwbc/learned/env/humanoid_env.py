"""The training environment: many robots, their commands, interventions, rewards and resets; torch in, torch out."""

import functools
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import torch

from hugwbc import gait as gaits
from hugwbc.commands import COMMAND_NAMES
from hugwbc.learned.config import EnvConfig
from hugwbc.learned.config.schedules import value_of
from hugwbc.learned.env import environment_state, terminations
from hugwbc.learned.env.arm_intervention import ArmGains, Intervention, make_arm_targets
from hugwbc.learned.env.curriculum import Curriculum, draw_commands, draw_gaits
from hugwbc.learned.env.loads import Loads
from hugwbc.learned.env.randomization import Latency, SensorErrors, draw_delays, push, rand, randint, randomize
from hugwbc.learned.env.readings import BIAS_TIME, Body, Readings, StepResult, Transition, read, tensor, to_heading
from hugwbc.learned.env.rewards import check_terms, evaluate_terms, relative_tracking, reward_terms
from hugwbc.learned.env.rough_ground import RoughGround, terrain_samples
from hugwbc.learned.env.running_statistics import Statistics
from hugwbc.learned.env.starts import COLUMNS, RecordedStarts, draw_starts
from hugwbc.learned.env.terminations import FeetRule
from hugwbc.learned.policy import critic_observations as obs
from hugwbc.learned.policy.critic_observations import Observation
from hugwbc.learned.policy.leg_feed_forward import CommandFeedForward
from hugwbc.learned.policy.terms import (
    COMMAND,
    ESTIMATE,
    FRAME,
    HISTORY_FRAMES,
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
LINK_CONTACT_FORCE = 2.0  # [N], above which the privileged observation flags a link
_F, _L, _H, _P = (COMMAND_NAMES.index(name) for name in ("f", "l", "h", "p"))
_ALL = slice(None)
# Parts of a recorded start besides the simulation's `qpos` and `qvel`, and `actions`, which is stored transposed.
_START_TENSORS = ("command", "gait", "phase", "history", "waist")


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
        command, gait, phase: commands (n, 8), gaits (n,) and common phases (n,).
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
        nominal_qpos: nominal stand at the origin, shape (7 + joints,).
        action_scale: radians of joint target per unit of action, shape (joints,).
        starts: recorded motion in which episodes may start; None if all episodes start from a stand.
        held_foot: rule that ends hops on both feet; None if it is off.
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
            interval=config.noise_interval,
            motions=config.motions,
            motions_seed=GENERATED_MOTIONS_SEED,
            generator=self.generator,
            paired=config.noise_paired,
        )
        self.intervention = Intervention(self._intervenable, config.flip_probability, targets, self.generator)
        self.arm_gains = ArmGains(self.simulation, self.robot)
        self.loads = Loads(self.simulation, self.robot, config.loads, ~self.agile, self.generator, self.dt)
        self.mass = tensor(self.simulation.expand("body_mass").sum(1) / self.robot.mass)
        seconds = np.zeros(self.count) if delays is None else delays * config.timestep
        self._body_facts = torch.stack((self.mass, tensor(seconds, place)), dim=1)
        self.adopt(config)
        self.body = Body.of(self.robot, self.dt, place)
        self.statistics = Statistics(self.count, self.robot.waist, place)
        self.further = further_terms(config.observations, self.robot)
        self._further_noise = obs.noise_amplitude(self.further, self.robot).to(place)
        joints = len(self.robot.joint_names)
        self.sensors = SensorErrors(self.count, joints, config.randomization.sensing, self.generator)
        grace = config.held_foot_grace
        self.held_foot = FeetRule(self.count, grace, self.dt, place) if grace > 0.0 else None
        self.starts = None if config.starts is None else RecordedStarts.load(config.starts, self.robot, place)
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
        if self.held_foot is not None:
            self.held_foot.due += self.age * self.dt

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
        fallen = self._fallen() | diverged
        self._filter_errors()
        transition = self._transition(previous, fallen)
        rewards = evaluate_terms(self._terms, transition, self.body, self.curriculum.penalty_scale)
        # A diverged state may hold NaN, and so may a term of a user's: neither must reach the sums of the others.
        reward = torch.nan_to_num(torch.stack(tuple(rewards.values())), nan=0.0, posinf=0.0, neginf=0.0).sum(0)
        truncated = ~fallen & (self.age >= self.config.episode_steps)
        done = fallen | truncated
        tracking = relative_tracking(rewards, self._terms, self.dt)
        self.statistics.add(rewards, tracking, transition, self.gait, self.age[done], diverged)
        self.statistics.note_gates(tracking, transition, self.agile)
        down = terminations.held_foot_down(self.readings, self.gait)
        self.statistics.add_share("held_foot_down", down, gaits.hopping(self.gait))
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
        """Write the joint targets of a control step: action, commanded waist angle, external control of the arms."""
        self.waist, self.posture = self._followed()
        target = self.body.nominal + self.action_scale * action + self._feed_forward(_ALL, self.waist, self.posture)
        self.intervention.alpha = self.curriculum.alpha
        # The paper excludes hopping: it is too unstable for arms under external control.
        self.intervention.eligible = self._intervenable & ~gaits.hopping(self.gait)
        self.intervention.step()
        target[:, self.body.arms] = self.intervention.blend(target[:, self.body.arms])
        self.arm_gains.update(self.intervention.active * self.curriculum.alpha)
        self.simulation.ctrl[:] = target

    def _followed(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Return waist, and height and pitch, of the feed-forward after the next control period."""
        waist, posture = self._commanded.follow(self.waist, self.posture, self.command)
        return waist, posture.float()

    def next_feed_forward(self) -> torch.Tensor:
        """Return what the next step adds to pose and action: waist, squat and swing [rad], shape (n, joints)."""
        return self._feed_forward(_ALL, *self._followed())

    def _feed_forward(self, robots: torch.Tensor | slice, waist: torch.Tensor, posture: torch.Tensor) -> torch.Tensor:
        told = (value[robots] for value in (self.phase, self.gait, self.command))
        return self._commanded.offsets(waist, posture, *told).float()

    def _fallen(self) -> torch.Tensor:
        """Return which episodes end early, shape (n,), bool."""
        fallen = terminations.fallen(self.readings, self.robot)
        if self.held_foot is not None:
            fallen |= self.held_foot.broken(terminations.held_foot_down(self.readings, self.gait), self.age)
        return fallen

    def _filter_errors(self) -> None:
        """Add the velocity errors of this step to their running means."""
        r = self.readings
        error = torch.cat((r.velocity[:, :2], r.yaw_rate[:, None]), dim=1) - self.command[:, :3]
        self.bias = self.bias + self.dt / BIAS_TIME * (torch.nan_to_num(error) - self.bias)

    def _transition(self, previous: Readings, fallen: torch.Tensor) -> Transition:
        feet = gaits.foot_phases(self.phase, self.gait)  # of both feet
        return Transition.between(
            previous,
            self.readings,
            command=self.command,
            gait=self.gait,
            bias=self.bias,
            action=self.actions[0],
            previous_action=self.actions[1],
            older_action=self.actions[2],
            target_clearance=gaits.swing_height(feet, self.command[:, [_L]]),
            contact=gaits.expected_contact(feet),
            bounce=torch.stack(gaits.bounce(self.phase, self.gait, self.command[:, _F]), dim=1),
            in_phase=feet[:, 0] == feet[:, 1],
            intervention=self.intervention.active,
            fallen=fallen,
        )

    # Curricula ------------------------------------------------------------------------------------------------------

    def update_curriculum(self) -> None:
        """Move the curricula after an iteration, based on the tracking rewards of moving robots of both groups."""
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
        """Restart robots (indices): nominal pose with noise or recorded motion, random heading, new command."""
        count = robots.numel()
        if not count:
            return
        self._place(robots, *draw_starts(self.nominal_qpos, robots, self.ground, self.generator))
        # A gait keeps its share of the time, however early its episodes end: drawn anew at each start, hops that are
        # not yet mastered had 2 % of the time instead of 20.
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
        moving = self._start_in_motion(robots)
        self.readings = read(self.simulation, self.ground)
        # A stand has no past, so its first frame fills the history; recorded motion brings its own.
        past = self.history[moving]
        self.history[robots] = self._frame()[robots, None]
        self.history[moving] = past

    def _place(
        self, robots: torch.Tensor, qpos: torch.Tensor, qvel: torch.Tensor, target: torch.Tensor | None = None
    ) -> None:
        """Write the state of robots (indices), and the joint target that has acted for ever: where the joints are."""
        target = qpos[:, 7:] if target is None else target
        for state, value in zip(("qpos", "qvel", "ctrl"), (qpos, qvel, target), strict=True):
            getattr(self.simulation, state)[robots] = self.simulation.tensor(value)
        if self.latency is not None:
            self.latency.reset(robots, target)

    def _draw_gaits(self, robots: torch.Tensor) -> torch.Tensor:
        return draw_gaits(robots.numel(), self.config.command, self.generator)

    def _draw_commands(self, robots: torch.Tensor, gait: torch.Tensor) -> None:
        """Draw new commands for robots (indices), in gaits, both of shape (k,)."""
        if robots.numel():
            self.gait[robots] = gait
            told = self.config.command, self.curriculum, self.generator
            self.command[robots] = draw_commands(gait, self.agile[robots], *told)
            self.bias[robots] = 0.0
            if self.held_foot is not None:
                self.held_foot.restart(robots, self.age[robots])

    def _start_in_motion(self, robots: torch.Tensor) -> torch.Tensor:
        """Replace the stand of some robots (indices), just set up, by recorded motion of their gait.

        They keep their place and take command and history from the record.

        Returns:
            Indices of the robots that start in motion; empty without a record.
        """
        if self.starts is None:
            return robots[:0]
        having, state = self.starts.draw(self.gait[robots], self.config.starts_share, self.generator)
        moving = robots[having]
        if not moving.numel():
            return moving
        for name in _START_TENSORS:
            getattr(self, name)[moving] = state[name]
        self.actions[:, moving] = state["actions"].transpose(0, 1)
        qpos, here = self.simulation.tensor(state["qpos"]).clone(), self.simulation.qpos[moving]
        qpos[:, :2] = here[:, :2]
        if self.ground is not None:  # the record is of a plane: lift it by the height of the ground here
            qpos[:, 2] += here[:, 2] - self.nominal_qpos[2]
        self.posture[moving] = self.command[moving][:, [_H, _P]]
        target = self.body.nominal + self.action_scale * self.actions[0, moving]
        target += self._feed_forward(moving, self.waist[moving], self.posture[moving])
        self._place(moving, qpos, state["qvel"], target)
        self.simulation.forward(moving)
        if self.held_foot is not None:
            self.held_foot.restart(moving, self.age[moving], in_motion=True)
        return moving

    def recorded(self, robots: torch.Tensor) -> dict[str, torch.Tensor]:
        """Return the present state of robots (indices) in the columns of `hugwbc.learned.env.starts.COLUMNS`."""
        columns = {name: getattr(self, name)[robots] for name in _START_TENSORS}
        columns["actions"] = self.actions[:, robots].transpose(0, 1)
        columns |= {name: getattr(self.simulation, name)[robots] for name in ("qpos", "qvel")}
        return {name: columns[name] for name in COLUMNS}

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
        command, further = observe(COMMAND, sensed), observe(self.further, sensed)
        if any(term.noise for term in self.further):
            further += (2.0 * rand(self.generator, *further.shape) - 1.0) * self._further_noise
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
        terrain = terrain_samples(self.ground, r.position[robots], r.heading[robots], height, self.robot.nominal_height)
        critic = torch.cat((history[:, -self.history.shape[2] :], command, privileged, further, terrain), dim=1)
        estimate = obs.side_by_side(ESTIMATE, velocity, clearance, height[:, None])
        return Observation(history, torch.cat((command, further), 1), critic, estimate)

    def _sensed(self, robots: torch.Tensor | slice, *frame: torch.Tensor) -> Sensed:
        """Return what robots (all, or indices) sense, in the order of `terms.FRAME`, and are told."""
        told = (self.command, self.gait, self.phase, self.intervention.active)
        return Sensed(*frame, *(value[robots] for value in told), pose=self._pose)

    # Checkpointing --------------------------------------------------------------------------------------------------

    def state_dict(self) -> dict[str, torch.Tensor]:
        """Return everything that a bit-exact continuation needs; some of the tensors are the environment's own."""
        return environment_state.state_of(self)

    def load_state_dict(self, state: dict[str, torch.Tensor]) -> None:
        """Restore what `state_dict` returned (`environment_state.restore`)."""
        environment_state.restore(self, state)


def _engine(device: str, threads: int) -> tuple[Callable[..., RobotBatch], torch.device]:
    """Return what makes the robots for a device of `HumanoidEnv`, and the device of their tensors."""
    if device == "cpu":
        return functools.partial(BatchSimulation, threads=threads), torch.device("cpu")
    from hugwbc.sim.warp_batch import WarpBatch

    place = torch.device("cpu" if device == "warp" else device)
    return functools.partial(WarpBatch, device=str(place)), place
