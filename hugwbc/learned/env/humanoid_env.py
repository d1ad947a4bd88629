"""The training environment: many H1s, commands and gaits, interventions, rewards and resets; torch in, torch out."""

import dataclasses

import numpy as np
import torch

from hugwbc import gait as gaits
from hugwbc.commands import COMMAND_NAMES
from hugwbc.gait import Gait
from hugwbc.learned import distributed
from hugwbc.learned.config import EnvConfig
from hugwbc.learned.env import env_observations, env_starts, env_state, terminations
from hugwbc.learned.env.action_latency import Latency, draw_delays
from hugwbc.learned.env.arm_intervention import Intervention
from hugwbc.learned.env.arm_targets import make_arm_targets
from hugwbc.learned.env.command_sampling import draw_commands
from hugwbc.learned.env.curriculum import Curriculum
from hugwbc.learned.env.randomization import push, randomize
from hugwbc.learned.env.readings import read, tensor
from hugwbc.learned.env.rewards import evaluate_terms, relative_tracking
from hugwbc.learned.env.rough_ground import RoughGround
from hugwbc.learned.env.running_statistics import Statistics
from hugwbc.learned.env.starts import RecordedStarts, draw_starts
from hugwbc.learned.env.transition import Body, Transition
from hugwbc.learned.policy import observations as obs
from hugwbc.learned.policy.observations import Observation
from hugwbc.robot import load_robot
from hugwbc.sim.scene import TRAINING_TIMESTEP
from hugwbc.sim.warp_batch import robots_on

GENERATED_MOTIONS_SEED = 0
_F, _L, _W = (COMMAND_NAMES.index(name) for name in ("f", "l", "w"))
_ALL = slice(None)


@dataclasses.dataclass(frozen=True, eq=False)
class StepResult:
    """Outcome of a control step.

    Attributes:
        reward: shape (n,).
        done: episode ended for any reason, shape (n,), bool.
        timed_out: indices of robots whose episode only ran out of time.
        final_critic: critic observation of those robots before their reset, for bootstrapping.
    """

    reward: torch.Tensor
    done: torch.Tensor
    timed_out: torch.Tensor
    final_critic: torch.Tensor


class HumanoidEnv:
    """n H1s in MuJoCo under the HugWBC training task.

    Attributes:
        config: the settings.
        ground: rough ground and the robots' levels; None on a plane.
        simulation: the robots.
        latency: joint targets under way; None if they act at once.
        readings: their state after the last step.
        curriculum: penalty, noise and speed levels.
        intervention: external arm control.
        statistics: running figures.
        command, gait, phase: commands (n, 8), gaits (n,), common phases (n,).
        age: control steps since the episode's start, shape (n,).
        actions: the last three policy outputs, newest first, shape (3, n, 19).
        history: last five proprioceptive frames, shape (n, 5, 63).
        friction: sliding friction of each robot, shape (n,).
        noise: half-widths of the observation noise, shape (63,).
        body: constants of the robot.
        waist: the waist's joint target before the action [rad], shape (n,).
        nominal_qpos: the nominal stand at the origin, shape (26,).
        action_scale: radians of joint target per unit of action, shape (19,).
        starts: recorded motion in which episodes may start; None for stands only.
        held_foot: rule that ends hops on both feet; None without.
    """

    def __init__(self, config: EnvConfig, *, seed: int, threads: int, device: str = "cpu") -> None:
        """Build and start all episodes, at random times within an episode so that resets do not coincide."""
        self.config = config
        self.robot = load_robot()
        self.count = config.count
        self.dt = TRAINING_TIMESTEP * config.substeps
        self.generator = torch.Generator().manual_seed(seed)
        self.ground = self._make_ground(seed)
        terrain = None if self.ground is None else self.ground.terrain
        self.simulation = robots_on(device, config.count, terrain=terrain, threads=threads)
        self.action_scale = tensor(config.action_scales(self.robot))
        rng = np.random.default_rng(seed)
        damping = config.damping(self.robot) / self.robot.kd
        self.friction = tensor(randomize(self.simulation, config.randomization, rng, damping))
        delays = draw_delays(self.count, config.randomization.latency, TRAINING_TIMESTEP, rng)
        self.latency = None if delays is None else Latency(delays, config.substeps, obs.JOINTS)
        self.nominal_qpos = self.simulation.model.key("nominal").qpos.copy()
        self.curriculum = Curriculum(config.curriculum)
        self.agile = torch.arange(self.count) < round(config.curriculum.agile_fraction * self.count)
        self._intervenable = ~self.agile & (config.intervention != "none")
        targets = make_arm_targets(
            config.intervention,
            self.count,
            interval=config.noise_interval,
            motions=config.motions,
            motions_seed=GENERATED_MOTIONS_SEED,
            generator=self.generator,
        )
        self.intervention = Intervention(self._intervenable, config.flip_probability, targets, self.generator)
        self._weights = dataclasses.asdict(config.rewards) | dataclasses.asdict(config.extra)
        self.body = Body.of(self.robot, self.dt)
        self.statistics = Statistics(self.count, self.robot.waist, hopping=config.command.hopping_fraction > 0.0)
        self.noise = obs.noise_amplitude() * config.randomization.noise
        grace = config.held_foot_grace
        self.held_foot = terminations.HeldFootRule(self.count, grace, self.dt) if grace > 0.0 else None
        self.starts = None if config.starts is None else RecordedStarts.load(config.starts)
        self.command = torch.zeros(self.count, len(COMMAND_NAMES))
        self.gait = torch.zeros(self.count, dtype=torch.long)
        self.phase = torch.zeros(self.count)
        self.age = torch.zeros(self.count, dtype=torch.long)
        self.actions = torch.zeros(3, self.count, obs.JOINTS)
        self.history = torch.zeros(self.count, obs.HISTORY_FRAMES, obs.PROPRIOCEPTION_SIZE)
        self.waist = torch.zeros(self.count)
        self.begin_episodes(torch.arange(self.count))
        self.age = torch.randint(config.episode_steps, (self.count,), generator=self.generator)
        if self.held_foot is not None:
            self.held_foot.due += self.age * self.dt

    def _make_ground(self, seed: int) -> RoughGround | None:
        terrain = self.config.terrain
        return RoughGround(self.count, terrain, np.random.default_rng(seed)) if terrain.roughness > 0.0 else None

    # Stepping -----------------------------------------------------------------------------------------------------

    def step(self, action: torch.Tensor) -> StepResult:
        """One control step with the policy's actions, shape (n, 19); finished episodes start anew."""
        self.actions = torch.stack((action, self.actions[0], self.actions[1]))
        previous_dq = self.readings.dq
        self._apply(action)
        push(self.simulation, self.config.randomization, self.generator)
        if self.ground is not None:
            self.ground.keep_inside(self.simulation, self.readings.position[:, :2])
        diverged = torch.from_numpy(self._simulate())
        self.age += 1
        self.phase = gaits.advance_phase(self.phase, self.command[:, _F], self.dt)
        self.readings = read(self.simulation, self.ground)
        fallen = self._fallen() | diverged
        transition = self._transition(previous_dq, fallen)
        rewards = evaluate_terms(transition, self.body, self._weights, self.curriculum.penalty_scale)
        # A diverged state may hold anything; its robot ends as a failure and must not touch the sums.
        reward = torch.nan_to_num(torch.stack(tuple(rewards.values())).sum(0), nan=0.0, posinf=0.0, neginf=0.0)
        done = fallen | (self.age >= self.config.episode_steps)
        timed_out = (done & ~fallen).nonzero().squeeze(1)
        tracking = relative_tracking(rewards, self._weights, self.dt)
        self.statistics.add(rewards, tracking, transition, self.gait, self.age[done], diverged)
        if self.config.command.hopping_fraction > 0.0:
            down = terminations.held_foot_down(self.readings, self.gait)
            self.statistics.add_share("held_foot_down", down, self.gait >= Gait.HOPPING_LEFT)
        self.history = torch.cat((self.history[:, 1:], env_observations.frame(self)[:, None]), dim=1)
        final_critic = self.observe(timed_out).critic
        due = (~done & (self.age % self.config.command.resample_steps == 0)).nonzero().squeeze(1)
        self._judge_speeds(done, due, fallen)
        self._draw_commands(due)
        ended = done.nonzero().squeeze(1)
        if self.ground is not None:
            self.ground.advance(ended, fallen[ended], self.statistics.tracking[ended, 0])
        self.begin_episodes(ended)
        return StepResult(reward, done, timed_out, final_critic)

    def _apply(self, action: torch.Tensor) -> None:
        target = self.body.nominal + self.action_scale * action
        self.waist = self.next_waist()
        target[:, self.body.waist] += self.waist
        self.intervention.alpha = self.curriculum.alpha
        # The paper: hopping is too unstable for arms under external control.
        self.intervention.eligible = self._intervenable & (self.gait < Gait.HOPPING_LEFT)
        self.intervention.step()
        target[:, self.body.arms] = self.intervention.blend(target[:, self.body.arms])
        self.simulation.ctrl[:] = target.numpy()

    def next_waist(self) -> torch.Tensor:
        """The waist's joint target of the next step before the action is added [rad], shape (n,)."""
        reach = self.config.waist_rate * self.dt
        return self.waist + (self.command[:, _W] - self.waist).clamp(-reach, reach)

    def _simulate(self) -> np.ndarray:
        if self.latency is None:
            return self.simulation.step(self.config.substeps)
        return self.latency.step(self.simulation)

    def _fallen(self) -> torch.Tensor:
        """Robots whose episode ends early, shape (n,), bool."""
        fallen = terminations.fallen(self.readings, self.robot)
        if self.held_foot is not None:
            fallen |= self.held_foot.broken(self.readings, self.gait, self.age)
        return fallen

    @property
    def command_time(self) -> torch.Tensor:
        """Time since each robot's command was drawn [s], shape (n,)."""
        return self.age % self.config.command.resample_steps * self.dt

    def bar_phase(self) -> torch.Tensor:
        """Homogenised phases of the left and the right foot, shape (n, 2)."""
        return gaits.homogenised_phase(gaits.foot_phases(self.phase, self.gait))

    def _transition(self, previous_dq: torch.Tensor, fallen: torch.Tensor) -> Transition:
        r, bar_phase = self.readings, self.bar_phase()
        return Transition(
            command=self.command,
            velocity=r.velocity,
            angular_velocity=r.angular_velocity,
            yaw_rate=r.yaw_rate,
            height=r.height,
            pitch=r.pitch,
            roll=r.roll,
            q=r.q,
            dq=r.dq,
            previous_dq=previous_dq,
            torque=r.torque,
            action=self.actions[0],
            previous_action=self.actions[1],
            older_action=self.actions[2],
            clearance=r.clearance,
            foot_velocity=r.foot_velocity,
            foot_force=r.foot_force,
            foot_offset=r.foot_offset,
            target_clearance=gaits.swing_height(bar_phase, self.command[:, [_L]]),
            contact=gaits.expected_contact(bar_phase),
            in_phase=bar_phase[:, 0] == bar_phase[:, 1],
            intervention=self.intervention.active,
            fallen=fallen,
        )

    def _judge_speeds(self, done: torch.Tensor, due: torch.Tensor, fallen: torch.Tensor) -> None:
        """Tell the curriculum how the commands of the agile group went that end now."""
        over = done & self.agile
        over[due] = self.agile[due]
        tracking = self.statistics.tracking[over] * ~fallen[over, None]
        self.curriculum.judge(self.gait[over], self.command[over], tracking)

    def update_curriculum(self) -> None:
        """Move the curricula after an iteration, from the running tracking rewards of both groups."""
        self.curriculum.update(
            self._mean_tracking(self.agile),
            self._mean_tracking(~self.agile) if self.config.intervention != "none" else None,
            terrain_mastered=self.ground is None or self.ground.mastered,
        )
        if self.ground is not None:
            self.curriculum.gates["terrain"] = self.ground.report()
            self.statistics.set_level("terrain_level", self.ground.mean_level)

    def _mean_tracking(self, group: torch.Tensor) -> tuple[float, float] | None:
        """Linear and angular tracking reward of some robots of all processes, (n,) bool; None if there are none."""
        if not bool(group.any()):
            return None
        linear, angular = distributed.mean(self.statistics.tracking[group].mean(0)).tolist()
        return linear, angular

    # Episodes -----------------------------------------------------------------------------------------------------

    def _draw_commands(self, robots: torch.Tensor) -> None:
        """New gait and command for some robots (indices)."""
        if robots.numel():
            self.command[robots], self.gait[robots] = draw_commands(
                self.agile[robots], self.config.command, self.curriculum, self.generator
            )
            if self.held_foot is not None:
                self.held_foot.restart(robots, self.age[robots])

    def begin_episodes(self, robots: torch.Tensor) -> None:
        """Start some robots (indices) anew: nominal pose with noise, random heading and velocities, new command."""
        count, ids = robots.numel(), robots.numpy()
        if not count:
            return
        qpos, qvel = draw_starts(self.nominal_qpos, robots, self.ground, self.generator)
        self.simulation.qpos[ids], self.simulation.qvel[ids] = qpos, qvel
        self.simulation.ctrl[ids] = qpos[:, 7:]
        if self.latency is not None:
            self.latency.reset(ids, qpos[:, 7:])
        self.simulation.forward(ids)
        self.phase[robots] = torch.rand(count, generator=self.generator)
        self.age[robots] = 0
        self.actions[:, robots] = 0.0
        self.waist[robots] = 0.0
        self.intervention.reset(robots)
        self._draw_commands(robots)
        moving = env_starts.start_in_motion(self, robots)
        self.readings = read(self.simulation, self.ground)
        past = self.history[moving]
        self.history[robots] = env_observations.frame(self)[robots, None]
        self.history[moving] = past

    def observe(self, robots: torch.Tensor | slice = _ALL) -> Observation:
        """Observations of the current state, of all robots or of some (indices)."""
        return env_observations.observe(self, robots)

    # Checkpointing ------------------------------------------------------------------------------------------------

    def state_dict(self) -> dict[str, torch.Tensor]:
        """Everything that a resumed run needs, as tensors."""
        return env_state.state_of(self)

    def load_state_dict(self, state: dict[str, torch.Tensor]) -> None:
        """Restore what `state_dict` gave."""
        env_state.restore(self, state)
