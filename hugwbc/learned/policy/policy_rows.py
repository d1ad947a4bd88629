"""One policy for any number of robots: each row has its own past and the same result as a robot by itself."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from hugwbc import gait as gaits
from hugwbc.commands import COMMAND_NAMES
from hugwbc.gait import Gait
from hugwbc.learned.policy import feed_forward, layout as obs
from hugwbc.learned.policy.leg_feed_forward import LegFeedForward, follow, swing_clearance
from hugwbc.learned.policy.own_terms import Sensed, own_columns, own_terms
from hugwbc.learned.policy.policy_contract import command_size, own_names
from hugwbc.robot import load_robot

_F, _W = COMMAND_NAMES.index("f"), COMMAND_NAMES.index("w")
_SQUAT = [COMMAND_NAMES.index("h"), COMMAND_NAMES.index("p")]
_CLOCK, _GAITS = len(COMMAND_NAMES) + len(Gait), np.arange(len(Gait))
Network = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


class PolicyRows:
    """Observations and actions of n robots under one policy.

    Observations are put together in NumPy, which takes a quarter of the time that torch takes for so few numbers.

    Attributes:
        kp, kd: gains of the joints [N*m/rad, N*m*s/rad], shape (19,).
        history: last five proprioceptive frames, oldest first, shape (n, 5, 63).
        observation: command observation, shape (n, 18); the terms of other packages come after the 18.
        action, estimate: last outputs of the network, shapes (n, 19) and (n, 6).
        phase: common phase of each robot's gait, shape (n,).
    """

    def __init__(self, metadata: dict[str, Any], network: Network, count: int) -> None:
        """Set up rows; call `reset` before the first `push`.

        Args:
            metadata: contract of the policy.
            network: function from history, shape (n, 315), and command observation to action and estimate; float32.
            count: number of robots.
        """
        vectors = (np.array(metadata[name], dtype=float) for name in ("nominal", "action_scale", "kp", "kd"))
        self._nominal, self._scale, self.kp, self.kd = vectors
        self._nominal_row = self._nominal.astype(np.float32)
        self._network = network
        self._feed_forward = feed_forward.of_contract(metadata)
        self._period = float(metadata["period"])
        self._waist_step = float(metadata["waist_rate"]) * self._period
        robot = load_robot(metadata["robot"])
        self._waist_joint = robot.waist
        self._squat_gain, self._swing_gain = (float(metadata.get(f"{name}_gain", 0.0)) for name in ("squat", "swing"))
        self._legs = LegFeedForward(robot)
        self._own = own_terms(own_names(metadata))
        self._command_scale = obs.command_scales()
        self.history = np.zeros((count, obs.HISTORY_FRAMES, obs.PROPRIOCEPTION_SIZE), dtype=np.float32)
        self.observation = np.zeros((count, command_size(metadata)), dtype=np.float32)
        self.action = np.zeros((count, obs.JOINTS), dtype=np.float32)
        self.estimate = np.zeros((count, obs.ESTIMATE_SIZE), dtype=np.float32)
        self.phase = np.zeros(count)
        self._waist, self._posture = np.zeros(count), np.zeros((count, 2))
        self._started = False

    def reset(self) -> None:
        """Forget the past of all rows; the next frame fills the histories, which are zero until then."""
        self.history = np.zeros_like(self.history)
        self.action = np.zeros_like(self.action)
        self.phase = np.zeros_like(self.phase)
        self._waist, self._posture = np.zeros_like(self._waist), np.zeros_like(self._posture)
        self._started = False

    def push(self, angular_velocity: np.ndarray, gravity: np.ndarray, q: np.ndarray, dq: np.ndarray) -> None:
        """Add a frame to the histories.

        Args:
            angular_velocity: angular velocity of the pelvis in its own frame [rad/s], shape (n, 3).
            gravity: unit vector of gravity in the pelvis frame, shape (n, 3).
            q: joint positions [rad], shape (n, 19).
            dq: joint velocities [rad/s], shape (n, 19).
        """
        omega, gravity, q, dq = (value.astype(np.float32) for value in (angular_velocity, gravity, q, dq))
        values = (omega, gravity, q - self._nominal_row, dq, self.action)
        scaled = [value * np.float32(part.scale) for value, part in zip(values, obs.FRAME, strict=True)]
        frame = np.concatenate(scaled, axis=1)
        if self._started:
            self.history = np.concatenate((self.history[:, 1:], frame[:, None]), axis=1)
        else:
            self.history[:] = frame[:, None]
            self._started = True

    def decide(self, command: np.ndarray, gait: np.ndarray, indicator: np.ndarray) -> np.ndarray:
        """Return the joint position targets for the next period [rad], shape (n, 19).

        Args:
            command: commands within their ranges, in the order of `COMMAND_NAMES`, shape (n, 8).
            gait: values of `Gait`, shape (n,).
            indicator: whether the arms are under external control, shape (n,), bool.
        """
        self.phase = gaits.advance_phase(self.phase, command[:, _F], self._period)
        command = self._feed_forward.asked(command, gait)
        self.observation = self._observe(command, gait, indicator)
        self.action, self.estimate = self._network(self.history.reshape(len(gait), -1), self.observation)
        q = self._nominal + self._scale * self.action
        self._waist += np.clip(command[:, _W] - self._waist, -self._waist_step, self._waist_step)
        q[:, self._waist_joint] += self._waist
        if self._squat_gain > 0.0 or self._swing_gain > 0.0:
            self._posture = follow(self._posture, command[:, _SQUAT], self._period)
            height, pitch = self._squat_gain * self._posture.T
            lifted = self._swing_gain * swing_clearance(self.phase, gait, command, self._period)
            q += self._legs.offsets(height, pitch, lifted)
        return q

    def _observe(self, command: np.ndarray, gait: np.ndarray, indicator: np.ndarray) -> np.ndarray:
        """Return the command observation of `hugwbc.learned.policy.observations` in the policy's layout."""
        phases = gaits.homogenised_phase(gaits.foot_phases(self.phase, gait))
        angle = 2.0 * math.pi * phases
        row = np.empty((len(gait), obs.COMMAND_SIZE), dtype=np.float32)
        row[:, : _CLOCK - len(Gait)] = command.astype(np.float32) * self._command_scale
        row[:, _CLOCK - len(Gait) : _CLOCK] = gait[:, None] == _GAITS
        row[:, _CLOCK : _CLOCK + 2], row[:, _CLOCK + 2 : _CLOCK + 4] = np.sin(angle), np.cos(angle)
        row[:, -1] = indicator
        if self._own:
            told = {"command": command, "gait": gait, "phases": phases, "indicator": np.asarray(indicator, dtype=bool)}
            sensed = Sensed.of_frame(self.history[:, -1], self._nominal, **told)
            return np.concatenate((row, own_columns(self._own, sensed)), axis=1)
        return row
