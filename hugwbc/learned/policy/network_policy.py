"""A policy network as a controller, whatever runs the network; it needs no torch."""

from typing import Any

import numpy as np

from hugwbc.commands import Command
from hugwbc.controller import JointCommand, UpperBody, override_arms
from hugwbc.learned.policy.policy_rows import Network, PolicyRows
from hugwbc.robot import load_robot
from hugwbc.state import RobotState

LARGEST_READING = 1e10  # [rad], [rad/s], MuJoCo's own bound; far beyond it the network overflows


def _is_readable(state: RobotState) -> bool:
    """Return whether the network can read a state: an action that overflowed would stay in its inputs for ever."""
    numbers = np.concatenate((state.q, state.dq, state.angular_velocity))
    return state.is_finite and float(np.abs(numbers).max()) <= LARGEST_READING


class NetworkPolicy:
    """A trained policy behind the common controller interface.

    Attributes:
        name: "learned".
        period: time between two actions [s].
        metadata: contract and training record of the policy.
        robot: robot that the policy was trained on, from the contract.
        held: number of unreadable states that were replaced by the last good observation.
    """

    name = "learned"

    def __init__(self, network: Network, metadata: dict[str, Any]) -> None:
        """Set up a controller for a network.

        Args:
            network: function from history and command observation to action and estimate.
            metadata: its contract, from `policy_contract` or `complete_contract`.
        """
        self.period = float(metadata["period"])
        self.metadata = metadata
        self.held = 0
        self.robot = load_robot(metadata["robot"])
        self._rows = PolicyRows(metadata, network, 1)

    @property
    def phase(self) -> float:
        """Common phase of `hugwbc.gait` in the period of the last command, in [0, 1)."""
        return float(self._rows.phase[0])

    def reset(self, state: RobotState) -> None:
        """Forget the past and fill the history with the first frame."""
        self._rows.reset()
        if _is_readable(state):
            self._push(state)

    def _push(self, state: RobotState) -> None:
        self._rows.push(state.angular_velocity[None], state.projected_gravity[None], state.q[None], state.dq[None])

    def act(self, state: RobotState, command: Command, upper_body: UpperBody) -> JointCommand:
        """Return the joint targets for the next period; arms under external control get the external targets.

        A state that is not finite, or beyond `LARGEST_READING`, leaves the history unchanged. Commands outside of
        their ranges are clamped.
        """
        if _is_readable(state):
            self._push(state)
        else:
            self.held += 1
        command, _ = command.clamp()
        rows = self._rows
        q = rows.decide(command.array()[None], np.array([int(command.gait)]), np.array([upper_body.indicator]))[0]
        zero = np.zeros_like(q)
        own = JointCommand(q=q, dq=zero, kp=rows.kp, kd=rows.kd, tau=zero)
        return override_arms(own, upper_body, self.robot)
