"""The training environment: many H1s, commands and gaits, interventions, rewards and resets; torch in, torch out."""

import dataclasses

import numpy as np
import torch

from hugwbc import gait as gaits
from hugwbc.commands import COMMAND_NAMES, command_ranges
from hugwbc.gait import Gait
from hugwbc.learned import observations as obs
from hugwbc.learned.config import EnvConfig
from hugwbc.learned.curriculum import MAX_SPEED, MAX_YAW_RATE, Curriculum
from hugwbc.learned.intervention import Intervention
from hugwbc.learned.randomization import randomize
from hugwbc.learned.rewards import Body, Transition, evaluate_terms
from hugwbc.robot import load_robot
from hugwbc.sim.batch import BatchSimulation
from hugwbc.sim.scene import TRAINING_TIMESTEP
from hugwbc.sim.simulation import FALL_HEIGHT, FALL_PITCH, FALL_ROLL, TRUNK_FORCE

LINK_CONTACT_FORCE = 2.0  # [N], above which the privileged observation flags a link
TRACKING_MEMORY = 0.99  # of the running averages that open the curricula
_V_X, _OMEGA = COMMAND_NAMES.index("v_x"), COMMAND_NAMES.index("omega")
_SIMULATION_STATE = ("qpos", "qvel", "ctrl", "warm_start")
_BEHAVIOUR = tuple(COMMAND_NAMES.index(name) for name in ("f", "l", "h", "p", "w"))


@dataclasses.dataclass(frozen=True, eq=False)
class Observation:
    """What the networks read.

    Attributes:
        history: last five proprioceptive frames, oldest first, shape (n, 315).
        command: shape (n, 13).
        critic: shape (n, 321).
        estimate: target of the estimator, shape (n, 6).
    """

    history: torch.Tensor
    command: torch.Tensor
    critic: torch.Tensor
    estimate: torch.Tensor


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


def _tensor(array: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(np.ascontiguousarray(array, dtype=np.float32))


def _rotate_inverse(quaternion: torch.Tensor, vector: torch.Tensor) -> torch.Tensor:
    w, u = quaternion[:, :1], -quaternion[:, 1:]
    t = 2.0 * torch.linalg.cross(u, vector)
    return vector + w * t + torch.linalg.cross(u, t)


class HumanoidEnv:
    """n H1s in MuJoCo under the HugWBC training task.

    Attributes:
        config: the settings.
        simulation: the robots.
        curriculum: penalty, noise and speed levels.
        intervention: external arm control.
        command, gait, phase: commands (n, 8), gaits (n,), common phases (n,).
        statistics: sums over steps since `pop_statistics`, by name.
    """

    def __init__(self, config: EnvConfig, *, seed: int, threads: int) -> None:
        """Build and start all episodes, at random times within an episode so that resets do not coincide."""
        self.config = config
        self.robot = load_robot()
        self.count = config.count
        self.dt = TRAINING_TIMESTEP * config.substeps
        self.generator = torch.Generator().manual_seed(seed)
        self.simulation = BatchSimulation(config.count, threads=threads)
        self._friction = _tensor(randomize(self.simulation, config.randomization, np.random.default_rng(seed)))
        self._key = self.simulation.model.key("nominal").qpos.copy()
        self.curriculum = Curriculum(config.curriculum)
        self.agile = torch.arange(self.count) < round(config.curriculum.agile_fraction * self.count)
        self.intervention = Intervention(~self.agile, config.flip_probability, config.noise_interval, self.generator)
        self._weights = dataclasses.asdict(config.rewards) | dataclasses.asdict(config.extra)
        self._body = self._make_body()
        self._noise = obs.noise_amplitude() * config.randomization.noise
        self._arms = torch.as_tensor(self.robot.arms)
        self._contact_links = self.robot.contact_links.index("torso_link")
        self.command = torch.zeros(self.count, len(COMMAND_NAMES))
        self.gait = torch.zeros(self.count, dtype=torch.long)
        self.phase = torch.zeros(self.count)
        self.age = torch.zeros(self.count, dtype=torch.long)
        self.actions = torch.zeros(3, self.count, obs.JOINTS)  # newest first
        self.history = torch.zeros(self.count, obs.HISTORY_FRAMES, obs.PROPRIOCEPTION_SIZE)
        self._tracking = torch.zeros(self.count, 2)
        self.statistics: dict[str, float] = {}
        self._statistics_steps = 0
        self._reset(torch.arange(self.count))
        self.age = torch.randint(config.episode_steps, (self.count,), generator=self.generator)
        self._read()
        self._restart_history(torch.arange(self.count))

    def _make_body(self) -> Body:
        robot = self.robot
        others = np.setdiff1d(np.arange(len(robot.joint_names)), robot.arms)
        return Body(
            nominal=_tensor(robot.nominal),
            lower=_tensor(robot.lower),
            upper=_tensor(robot.upper),
            arms=torch.as_tensor(robot.arms),
            hips=torch.as_tensor(robot.hip_yaw_roll),
            waist_and_legs=torch.as_tensor(others),
            waist=robot.waist,
            dt=self.dt,
        )

    # Commands -----------------------------------------------------------------------------------------------------

    def _uniform(self, count: int, low: float | torch.Tensor, high: float | torch.Tensor) -> torch.Tensor:
        return low + torch.rand(count, generator=self.generator) * (high - low)

    def _draw_commands(self, robots: torch.Tensor) -> None:
        """New gait and command for some robots (indices)."""
        count, settings = robots.numel(), self.config.command
        draw = torch.rand(count, generator=self.generator)
        standing = draw < settings.standing_fraction
        walking = draw < settings.standing_fraction + settings.walking_fraction
        gait = torch.where(standing, int(Gait.STANDING), torch.where(walking, int(Gait.WALKING), int(Gait.JUMPING)))
        ranges = command_ranges(Gait.WALKING)
        command = torch.empty(count, len(COMMAND_NAMES))
        for i, name in enumerate(COMMAND_NAMES):
            command[:, i] = self._uniform(count, *ranges[name].initial)
        agile = self.agile[robots]
        fast = torch.where(agile, self.curriculum.max_speed, MAX_SPEED[0])
        command[:, _V_X] = self._uniform(count, ranges["v_x"].initial[0], fast)
        turn = torch.where(agile, self.curriculum.max_yaw_rate, MAX_YAW_RATE[0])
        command[:, _OMEGA] = self._uniform(count, -turn, turn)
        for i in _BEHAVIOUR:
            at_default = torch.rand(count, generator=self.generator) < settings.default_fraction
            command[at_default, i] = ranges[COMMAND_NAMES[i]].default
        still = torch.rand(count, generator=self.generator) < settings.zero_velocity_fraction
        command[standing | still, : _OMEGA + 1] = 0.0
        self.command[robots], self.gait[robots] = command, gait

    # Resets -------------------------------------------------------------------------------------------------------

    def _reset(self, robots: torch.Tensor) -> None:
        """Start new episodes: nominal pose with noise, random heading and velocities, new command."""
        count = robots.numel()
        ids = robots.numpy()
        yaw = self._uniform(count, -np.pi, np.pi).numpy()
        qpos = np.tile(self._key, (count, 1))
        qpos[:, 3], qpos[:, 6] = np.cos(yaw / 2.0), np.sin(yaw / 2.0)
        qpos[:, 7:] += (0.2 * torch.rand((count, obs.JOINTS), generator=self.generator) - 0.1).numpy()
        qvel = np.zeros((count, self.simulation.qvel.shape[1]))
        qvel[:, :6] = (0.6 * torch.rand((count, 6), generator=self.generator) - 0.3).numpy()
        self.simulation.qpos[ids], self.simulation.qvel[ids] = qpos, qvel
        self.simulation.ctrl[ids] = qpos[:, 7:]
        self.simulation.forward(ids)
        self.phase[robots] = torch.rand(count, generator=self.generator)
        self.age[robots] = 0
        self.actions[:, robots] = 0.0
        self.intervention.reset(robots)
        self._draw_commands(robots)

    def _restart_history(self, robots: torch.Tensor) -> None:
        self.history[robots] = self._frame()[robots, None]

    # Stepping -----------------------------------------------------------------------------------------------------

    def step(self, action: torch.Tensor) -> StepResult:
        """One control step with the policy's actions, shape (n, 19); finished episodes start anew."""
        self.actions = torch.stack((action, self.actions[0], self.actions[1]))
        previous_dq = self.dq
        self._apply(action)
        self._push()
        diverged = torch.from_numpy(self.simulation.step(self.config.substeps))
        self.age += 1
        self.phase = gaits.advance_phase(self.phase, self.command[:, 3], self.dt)
        self._read()
        fallen = self._fallen() | diverged
        transition = self._transition(previous_dq, fallen)
        rewards = evaluate_terms(transition, self._body, self._weights, self.curriculum.penalty_scale)
        # A diverged state may hold anything; its robot ends as a failure and must not touch the sums.
        reward = torch.nan_to_num(torch.stack(tuple(rewards.values())).sum(0), nan=0.0, posinf=0.0, neginf=0.0)
        done = fallen | (self.age >= self.config.episode_steps)
        timed_out = (done & ~fallen).nonzero().squeeze(1)
        self._collect(rewards, transition, done, diverged)
        self._push_history()
        final_critic = self.observe().critic[timed_out] if timed_out.numel() else torch.empty(0, obs.CRITIC_SIZE)
        self._begin_episodes(done)
        return StepResult(reward, done, timed_out, final_critic)

    def _begin_episodes(self, done: torch.Tensor) -> None:
        due = (~done & (self.age % self.config.command.resample_steps == 0)).nonzero().squeeze(1)
        if due.numel():
            self._draw_commands(due)
        finished = done.nonzero().squeeze(1)
        if finished.numel():
            self._reset(finished)
            self._read()
            self._restart_history(finished)

    def _apply(self, action: torch.Tensor) -> None:
        target = self._body.nominal + self.config.action_scale * action
        self.intervention.alpha = self.curriculum.alpha
        self.intervention.step()
        if self.curriculum.alpha > 0.0:
            target[:, self._arms] = self.intervention.blend(target[:, self._arms])
        self.simulation.ctrl[:] = target.numpy()

    def _push(self) -> None:
        settings = self.config.randomization
        pushed = torch.rand(self.count, generator=self.generator) < 1.0 / settings.push_interval
        ids = pushed.nonzero().squeeze(1)
        if ids.numel():
            kick = (2.0 * torch.rand((ids.numel(), 2), generator=self.generator) - 1.0) * settings.push_velocity
            self.simulation.qvel[ids.numpy(), :2] += kick.numpy()

    def _read(self) -> None:
        """Copy the simulation's state into float32 tensors, and derive what rewards and observations share."""
        sim = self.simulation
        qpos, qvel = _tensor(sim.qpos), _tensor(sim.qvel)
        orientation = torch.nn.functional.normalize(qpos[:, 3:7], dim=1)
        self.q, self.dq, self.angular_velocity = qpos[:, 7:], qvel[:, 6:], qvel[:, 3:6]
        w, x, y, z = orientation.unbind(1)
        self.roll = torch.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
        self.pitch = torch.asin((2.0 * (w * y - x * z)).clamp(-1.0, 1.0))
        heading = torch.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        cos, sin = heading.cos(), heading.sin()
        self._heading = (cos, sin)
        self.gravity = _rotate_inverse(orientation, torch.tensor([[0.0, 0.0, -1.0]]).expand(self.count, 3))
        self.velocity = self._to_heading(qvel[:, :3])
        # World z component of the angular velocity: its projection on the up direction, which is minus gravity.
        self.yaw_rate = -(self.gravity * self.angular_velocity).sum(1)
        self.height = qpos[:, 2] - self.robot.nominal_height
        soles = _tensor(sim.sole_position())
        self.clearance = soles[..., 2]
        self.foot_offset = self._to_heading(soles[:, 0] - soles[:, 1])
        self.foot_velocity, self.foot_force = _tensor(sim.sole_velocity()), _tensor(sim.foot_force())
        self.link_force = _tensor(sim.link_force())
        self.bar_phase = gaits.homogenised_phase(gaits.foot_phases(self.phase, self.gait))

    def _to_heading(self, vector: torch.Tensor) -> torch.Tensor:
        cos, sin = self._heading
        x, y, z = vector.unbind(1)
        return torch.stack((cos * x + sin * y, cos * y - sin * x, z), dim=1)

    def _fallen(self) -> torch.Tensor:
        """The paper's early termination; trunk contact does not count under intervention, when arms may hit it."""
        trunk = (self.link_force[:, self._contact_links] > TRUNK_FORCE) & ~self.intervention.active
        tilted = (self.pitch.abs() > FALL_PITCH) | (self.roll.abs() > FALL_ROLL)
        return trunk | tilted | (self.height + self.robot.nominal_height < FALL_HEIGHT)

    def _transition(self, previous_dq: torch.Tensor, fallen: torch.Tensor) -> Transition:
        return Transition(
            command=self.command,
            velocity=self.velocity,
            angular_velocity=self.angular_velocity,
            yaw_rate=self.yaw_rate,
            height=self.height,
            pitch=self.pitch,
            roll=self.roll,
            q=self.q,
            dq=self.dq,
            previous_dq=previous_dq,
            torque=_tensor(self.simulation.torque),
            action=self.actions[0],
            previous_action=self.actions[1],
            older_action=self.actions[2],
            clearance=self.clearance,
            foot_velocity=self.foot_velocity,
            foot_force=self.foot_force,
            foot_offset=self.foot_offset,
            target_clearance=gaits.swing_height(self.bar_phase, self.command[:, 4:5]),
            contact=gaits.expected_contact(self.bar_phase),
            in_phase=self.bar_phase[:, 0] == self.bar_phase[:, 1],
            intervention=self.intervention.active,
            fallen=fallen,
        )

    # Observations -------------------------------------------------------------------------------------------------

    def _frame(self) -> torch.Tensor:
        frame = obs.proprioception(
            self.angular_velocity, self.gravity, self.q - self._body.nominal, self.dq, self.actions[0]
        )
        noise = 2.0 * torch.rand(frame.shape, generator=self.generator) - 1.0
        return frame + noise * self._noise

    def _push_history(self) -> None:
        self.history = torch.cat((self.history[:, 1:], self._frame()[:, None]), dim=1)

    def observe(self) -> Observation:
        """Observations of the current state."""
        history = self.history.flatten(1)
        command = obs.command_observation(
            self.command, self.gait, gaits.clock(self.bar_phase), self.intervention.active
        )
        privileged = obs.privileged(
            self.velocity,
            self.height - self.command[:, 5],
            self.clearance,
            self._friction,
            self.foot_force,
            self.link_force > LINK_CONTACT_FORCE,
        )
        # Flat ground: every terrain sample lies the same distance below the pelvis.
        terrain = (self.height * obs.LENGTH_SCALE)[:, None].expand(-1, obs.TERRAIN_SIZE)
        critic = torch.cat((history[:, -obs.PROPRIOCEPTION_SIZE :], command, privileged, terrain), dim=1)
        return Observation(history, command, critic, obs.estimate_target(self.velocity, self.clearance, self.height))

    # Statistics ---------------------------------------------------------------------------------------------------

    def _collect(
        self, rewards: dict[str, torch.Tensor], t: Transition, done: torch.Tensor, diverged: torch.Tensor
    ) -> None:
        """Add this step to the running sums, and to the averages that the curricula read."""
        linear = rewards["linear_velocity_tracking"] / (self._weights["linear_velocity_tracking"] * self.dt)
        angular = rewards["angular_velocity_tracking"] / (self._weights["angular_velocity_tracking"] * self.dt)
        now = torch.nan_to_num(torch.stack((linear, angular), dim=1))
        self._tracking = TRACKING_MEMORY * self._tracking + (1.0 - TRACKING_MEMORY) * now
        walking = (self.gait == Gait.WALKING).float()
        measured = (t.velocity[:, 0], t.velocity[:, 1], t.yaw_rate, t.height, t.pitch, t.q[:, self.robot.waist])
        columns = (0, 1, 2, 5, 6, 7)
        error = (torch.stack(measured, dim=1) - t.command[:, columns]).abs()
        walking_error = (error * walking[:, None]).sum(0) / walking.sum().clamp(min=1.0)
        values = {f"reward/{name}": float(value.mean()) for name, value in rewards.items()}
        for column, value in zip(columns, walking_error.tolist(), strict=True):
            values[f"walking_error/{COMMAND_NAMES[column]}"] = value
        values["episodes"] = float(done.sum())
        values["falls"] = float(t.fallen.sum())
        values["diverged"] = float(diverged.sum())
        values["finished_steps"] = float(self.age[done].sum())
        for name, value in values.items():
            if np.isfinite(value):
                self.statistics[name] = self.statistics.get(name, 0.0) + value
        self._statistics_steps += 1

    def pop_statistics(self) -> dict[str, float]:
        """Averages since the last call (per step), with the mean length of the finished episodes; then start anew."""
        totals, steps = self.statistics, max(self._statistics_steps, 1)
        self.statistics, self._statistics_steps = {}, 0
        counts = ("episodes", "falls", "diverged", "finished_steps")
        result = {name: value / steps for name, value in totals.items() if name not in counts}
        result |= {name: totals.get(name, 0.0) for name in ("episodes", "falls", "diverged")}
        result["episode_length"] = totals.get("finished_steps", 0.0) / max(totals.get("episodes", 0.0), 1.0)
        return result

    def update_curriculum(self) -> None:
        """Move the curricula after an iteration, from the running tracking rewards of both groups."""
        agile = self._tracking[self.agile].mean(0).tolist()
        intervened = self._tracking[~self.agile].mean(0).tolist()
        self.curriculum.update((agile[0], agile[1]), (intervened[0], intervened[1]))

    # Checkpointing ------------------------------------------------------------------------------------------------

    def state_dict(self) -> dict[str, torch.Tensor]:
        """Everything that a resumed run needs, as tensors."""
        names = ("command", "gait", "phase", "age", "actions", "history", "_tracking")
        state = {name.lstrip("_"): getattr(self, name) for name in names}
        state |= {name: torch.from_numpy(getattr(self.simulation, name).copy()) for name in _SIMULATION_STATE}
        # Forces belong to the last physics step; they cannot be had again from the state alone.
        state["foot_force"], state["link_force"] = self.foot_force, self.link_force
        state["generator"] = self.generator.get_state()
        state |= {f"intervention.{k}": v for k, v in self.intervention.state_dict().items()}
        levels = self.curriculum.state_dict()
        state |= {f"curriculum.{k}": torch.tensor(v, dtype=torch.float64) for k, v in levels.items()}
        return state

    def load_state_dict(self, state: dict[str, torch.Tensor]) -> None:
        """Restore what `state_dict` gave."""
        for name in ("command", "gait", "phase", "age", "actions", "history"):
            setattr(self, name, state[name].clone())
        self._tracking = state["tracking"].clone()
        self.generator.set_state(state["generator"])
        prefixed = {"intervention": {}, "curriculum": {}}
        for key, value in state.items():
            group, _, name = key.partition(".")
            if name:
                prefixed[group][name] = value
        self.intervention.load_state_dict(prefixed["intervention"])
        self.curriculum.load_state_dict({name: float(value) for name, value in prefixed["curriculum"].items()})
        # Twice: the first write gives `forward` its state, the second undoes its change of the warm start.
        self._write_simulation(state)
        self.simulation.forward(np.arange(self.count))
        self._write_simulation(state)
        self._read()
        self.foot_force, self.link_force = state["foot_force"].clone(), state["link_force"].clone()

    def _write_simulation(self, state: dict[str, torch.Tensor]) -> None:
        for name in _SIMULATION_STATE:
            getattr(self.simulation, name)[:] = state[name].numpy()
