"""The observation that a contract describes, from the robot's state, the command, the last action and the clock."""

import dataclasses
import math
from collections.abc import Callable, Mapping

import numpy as np

from hugwbc import rotations
from hugwbc.commands import Command
from hugwbc.robot import load_robot
from hugwbc.runtime.foreign.contract import PolicyContract, Term
from hugwbc.state import RobotState


@dataclasses.dataclass(frozen=True, eq=False)
class Reading:
    """The inputs of the observation terms.

    Attributes:
        state: state of the robot.
        command: the clamped command.
        action: the last action of the network, clipped, in the order of the contract's joints.
        phase: phase of the gait clock, in [0, 1).
        reference: default pose of all joints [rad], shape (19,).
    """

    state: RobotState
    command: Command
    action: np.ndarray
    phase: float
    reference: np.ndarray


def _linear_velocity(term: Term, reading: Reading) -> np.ndarray:
    if reading.state.velocity is None:
        return np.zeros(3)
    return rotations.rotate_inverse(reading.state.orientation, reading.state.velocity)


def _joint_position(term: Term, reading: Reading) -> np.ndarray:
    joints = load_robot().indices(term.names)
    return reading.state.q[joints] - (0.0 if term.absolute else reading.reference[joints])


def _phase(wave: Callable[[float], float]) -> Callable[[Term, Reading], np.ndarray]:
    return lambda term, reading: np.array([wave(2.0 * math.pi * (reading.phase + term.offset))])


# Velocities of the pelvis are in its own frame; linear_velocity is zero if the state has none.
TERMS: Mapping[str, Callable[[Term, Reading], np.ndarray]] = {
    "angular_velocity": lambda term, reading: reading.state.angular_velocity,
    "linear_velocity": _linear_velocity,
    "gravity": lambda term, reading: reading.state.projected_gravity,
    "command": lambda term, reading: np.array([getattr(reading.command, name) for name in term.names]),
    "joint_position": _joint_position,
    "joint_velocity": lambda term, reading: reading.state.dq[load_robot().indices(term.names)],
    "last_action": lambda term, reading: reading.action,
    "phase_sin": _phase(math.sin),
    "phase_cos": _phase(math.cos),
    "constant": lambda term, reading: np.array(term.value),
}


def observe(contract: PolicyContract, reading: Reading) -> np.ndarray:
    """Return one observation, scaled and clipped, shape (observation_size,)."""
    parts = [TERMS[term.kind](term, reading) * np.array(term.scale) for term in contract.observation]
    return np.clip(np.concatenate(parts), -contract.observation_clip, contract.observation_clip)


class ObservationHistory:
    """The last observations, in the arrangement that the network expects."""

    def __init__(self, contract: PolicyContract) -> None:
        self._settings = contract.history
        self._ends = np.cumsum([term.size for term in contract.observation])[:-1]
        self._size = contract.observation_size
        self.reset()

    def reset(self) -> None:
        """Forget the past."""
        self._frames = np.zeros((self._settings.frames, self._size))
        self._empty = True

    def push(self, observation: np.ndarray) -> None:
        """Add the newest observation, shape (observation_size,)."""
        if self._empty and self._settings.start == "first_frame":
            self._frames[:] = observation
        self._empty = False
        self._frames = np.concatenate((self._frames[1:], observation[None]))

    def input(self) -> np.ndarray:
        """Return the network's input, shape (input_size,)."""
        frames = self._frames if self._settings.order == "oldest_first" else self._frames[::-1]
        if self._settings.layout == "by_frame":
            return frames.ravel()
        return np.concatenate([part.ravel() for part in np.split(frames, self._ends, axis=1)])
