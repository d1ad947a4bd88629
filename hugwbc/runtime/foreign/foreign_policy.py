"""A policy of another project as a controller."""

import pathlib

import numpy as np

from hugwbc import gait as gaits
from hugwbc.commands import Command
from hugwbc.controller import JointCommand, UpperBody, override_arms
from hugwbc.errors import PolicyFileError
from hugwbc.robot import load_robot
from hugwbc.runtime.foreign.contract import PolicyContract
from hugwbc.runtime.foreign.contract_file import load_contract
from hugwbc.runtime.foreign.network import Network, load_network
from hugwbc.runtime.foreign.observation import ObservationHistory, Reading, observe
from hugwbc.state import RobotState


def load_foreign_policy(contract: str | pathlib.Path, policy: str | pathlib.Path | None = None) -> "ForeignPolicy":
    """Build a controller from a contract and its network.

    Args:
        contract: name of a shipped contract, or path of a contract file or of a folder with a `contract.yaml`.
        policy: the network's file; None for the file that the contract names.

    Raises:
        UnknownNameError: if there is no such contract.
        ContractError: if the contract is malformed; it names the line.
        PolicyFileError: if the network file is missing, cannot be read, or does not fit the contract.
    """
    settings = load_contract(contract)
    path = settings.policy if policy is None else pathlib.Path(policy)
    if path is None:
        raise PolicyFileError(f"the contract {contract} names no policy file; give one with --policy FILE")
    network = load_network(path, settings.state)
    _try(network, settings, path)
    return ForeignPolicy(settings, network)


def _try(network: Network, contract: PolicyContract, path: pathlib.Path) -> None:
    """Refuse a network whose input or output does not fit the contract."""
    terms = " + ".join(f"{term.kind} {term.size}" for term in contract.observation)
    asked = f"{contract.history.frames} x ({terms}) = {contract.input_size} numbers"
    try:
        network.reset()
        action = network(np.zeros(contract.input_size))
    except Exception as error:  # whatever torch and onnxruntime raise on a wrong shape
        reason = str(error).strip().splitlines()[-1]
        raise PolicyFileError(f"{path} does not take the contract's observation, {asked}: {reason}") from error
    if action.shape != (len(contract.joints),) or not np.isfinite(action).all():
        raise PolicyFileError(
            f"{path} gives {action.size} actions ({np.isfinite(action).sum()} finite), the contract has "
            f"{len(contract.joints)} joints: {', '.join(contract.joints)}; make them agree"
        )


class ForeignPolicy:
    """A network and its contract behind the common controller interface.

    Joints that the policy does not move are held at the robot's nominal pose (or the contract's) with the robot's
    nominal gains. Arms under external control follow their targets.

    Attributes:
        name: name of the contract.
        period: time between two actions [s].
        contract: description of the network.
        held: number of states and actions that were not finite and were replaced by the last good ones.
    """

    def __init__(self, contract: PolicyContract, network: Network) -> None:
        """Build the controller from a network that fits the contract."""
        self.contract = contract
        self.name, self.period = contract.name, contract.period
        self.held = 0
        self.robot = load_robot()
        self._network = network
        self._joints = self.robot.indices(contract.joints)
        self._reference = self.robot.nominal.copy()
        for name, angle in contract.held_pose:
            self._reference[self.robot.index(name)] = angle
        self._reference[self._joints] = contract.default_pose
        self._kp, self._kd = self.robot.kp.copy(), self.robot.kd.copy()
        self._kp[self._joints], self._kd[self._joints] = contract.kp, contract.kd
        self._scale = np.array(contract.action_scale)
        self._history = ObservationHistory(contract)
        self._start()

    def _start(self) -> None:
        self._history.reset()
        self._network.reset()
        self._action = np.zeros(len(self._joints))
        self._phase = 0.0

    def reset(self, state: RobotState) -> None:
        """Forget the past: history, recurrent state, last action and clock."""
        self._start()

    def act(self, state: RobotState, command: Command, upper_body: UpperBody) -> JointCommand:
        """Return joint targets for the next period; arms under external control take their targets.

        A state that is not finite leaves the history unchanged. An action that is not finite leaves the targets
        unchanged and clears the network's memory, in which the bad number might remain.
        """
        command, _ = command.clamp()
        frequency = command.f if self.contract.clock_period is None else 1.0 / self.contract.clock_period
        self._phase = float(gaits.advance_phase(self._phase, frequency, self.period))
        if state.is_finite:
            reading = Reading(state, command, self._action, self._phase, self._reference)
            self._history.push(observe(self.contract, reading))
        else:
            self.held += 1
        action = self._network(self._history.input())
        if np.isfinite(action).all():
            self._action = np.clip(action, -self.contract.action_clip, self.contract.action_clip)
        else:
            self.held += 1
            self._network.reset()
        q = self._reference.copy()
        q[self._joints] += self._scale * self._action
        zero = np.zeros_like(q)
        return override_arms(JointCommand(q, zero, self._kp, self._kd, zero), upper_body, self.robot)
