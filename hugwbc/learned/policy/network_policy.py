"""A policy's network, ours or another project's, as a controller by its contract; only some networks need torch."""

import dataclasses
import logging
import pathlib
from collections.abc import Mapping, Sequence

import numpy as np

from hugwbc import gait as gaits, rotations
from hugwbc.commands import COMMAND_NAMES, Command
from hugwbc.controller import JointCommand, UpperBody, override_arms
from hugwbc.errors import PolicyFileError
from hugwbc.learned.policy.contract import Contract, Term, contract_of, load_contract
from hugwbc.learned.policy.leg_feed_forward import CommandFeedForward
from hugwbc.learned.policy.network_files import Network, OnnxNetwork, TorchScriptNetwork, load_network
from hugwbc.learned.policy.terms import TERMS, Sensed, scaled
from hugwbc.state import RobotState

_GAIN_FACTOR = 10.0  # times the robot's own gains are plausible; public policies have up to 5 times
_SQUATS = 0.05  # [m]; a pelvis that is farther than this from its nominal height is in a squat
_log = logging.getLogger(__name__)
_F = COMMAND_NAMES.index("f")


def load_contract_policy(contract: str | pathlib.Path, network: str | pathlib.Path | None = None) -> "NetworkPolicy":
    """Build a controller from a contract and its network.

    Args:
        contract: name of a shipped contract, or path of a contract file or of a folder with a `contract.yaml`.
        network: the network's file; None for the file that the contract names.
    """
    settings = load_contract(contract)
    path = settings.policy if network is None else pathlib.Path(network)
    if path is None:
        raise PolicyFileError(f"the contract {contract} names no policy file; give one with --policy FILE")
    return NetworkPolicy(settings, tried(load_network(path, settings.state), settings, path))


def load_onnx_policy(path: pathlib.Path) -> "NetworkPolicy":
    """Load a policy that `hugwbc export` wrote; its joint targets are those of the policy, up to rounding."""
    network = load_network(path, {})
    assert isinstance(network, OnnxNetwork)
    if "contract" not in network.metadata:
        raise PolicyFileError(
            f"{path} is a bare network: it has no contract of `hugwbc export`. Write a contract for it as "
            "docs/evaluation.md says, and give the contract"
        )
    contract = contract_of(network.metadata, path)
    return NetworkPolicy(contract, tried(network, contract, path))


def tried(network: Network, contract: Contract, path: pathlib.Path) -> Network:
    """Return a network after checking that its inputs and outputs fit a contract."""
    sizes = contract.input_sizes
    terms = [" + ".join(f"{t.term} {contract.size(t)}" for t in part) for part in _inputs(contract)]
    asked = f"{contract.history.frames} x ({'), and ('.join(terms)}) = {' and '.join(map(str, sizes))} numbers"
    try:
        network.reset()
        given = [np.zeros(size, np.float32) for size in sizes]
        if isinstance(network, OnnxNetwork | TorchScriptNetwork):
            network.action = _action_of(network.outputs(given), contract, path)
            network.reset()
        action = network(given)
    except PolicyFileError:
        raise
    except Exception as error:  # whatever torch and onnxruntime raise on a wrong shape
        reason = str(error).strip().splitlines()[-1]
        raise PolicyFileError(f"{path} does not take the contract's observation, {asked}: {reason}") from error
    if action.shape != (len(contract.joints),) or not np.isfinite(action).all():
        raise PolicyFileError(
            f"{path} gives {action.size} actions ({np.isfinite(action).sum()} finite), the contract has "
            f"{len(contract.joints)} joints: {', '.join(contract.joints)}; make them agree"
        )
    _check_gains(contract, path)
    return network


def _action_of(found: Mapping[str, np.ndarray], contract: Contract, path: pathlib.Path) -> str:
    """Return the output with the actions: the contract's, the only one, the one so named, or the only one that fits."""
    fitting = [name for name, part in found.items() if part.size == len(contract.joints)]
    named = [name for name in found if name.casefold() in ("action", "actions")]
    wanted = [contract.action] if contract.action else list(found) if len(found) == 1 else named or fitting
    if len(wanted) != 1 or wanted[0] not in found:
        sizes = ", ".join(f"{name} ({part.size})" for name, part in found.items())
        raise PolicyFileError(
            f"{path} has the outputs {sizes}, and {contract.action or f'{len(wanted)} of them'} could be the actions "
            f"of {len(contract.joints)} joints; say in the contract which one is: action: NAME"
        )
    return wanted[0]


def _check_gains(contract: Contract, path: pathlib.Path) -> None:
    """Log gains with which a joint's drive would oscillate, or that are far above those of the robot.

    A delay t takes kp * t away from the damping kd of a joint, and nothing is left from kp * t = kd on.
    """
    robot = contract.described
    for name, kp, kd in zip(contract.joints, contract.kp, contract.kd, strict=True):
        joint = robot.index(name)
        if kp * robot.command_delay >= kd or max(kp / robot.kp[joint], kd / robot.kd[joint]) > _GAIN_FACTOR:
            _log.warning(
                "%s: %s has kp = %g and kd = %g in the contract, with which the robot may shake; plausible are up to "
                "%g times the robot's %g and %g, and kd above %g * kp",
                *(path, name, kp, kd, _GAIN_FACTOR, robot.kp[joint], robot.kd[joint], robot.command_delay),
            )


def _inputs(contract: Contract) -> tuple[tuple[Term, ...], ...]:
    return (contract.observation, contract.command) if contract.command else (contract.observation,)


class NetworkPolicy:
    """A network and its contract behind the common controller interface.

    Joints that the policy does not move are held at the robot's nominal pose (or the contract's) with the robot's
    nominal gains. Arms under external control follow their targets.

    Attributes:
        name: name of the contract.
        period: time between two actions [s].
        contract: description of the network.
        robot: robot that the policy was made for.
        inputs: what the network read last.
    """

    def __init__(self, contract: Contract, network: Network) -> None:
        """Build the controller from a network that fits the contract."""
        self.contract = contract
        self.name, self.period = contract.name, contract.period
        self.robot = contract.described
        self._network = network
        self._joints = self.robot.indices(contract.joints)
        self._pose = self.robot.nominal.copy()
        for name, angle in contract.held_pose.items():
            self._pose[self.robot.index(name)] = angle
        self._pose[self._joints] = contract.default_pose
        self._kp, self._kd = self.robot.kp.copy(), self.robot.kd.copy()
        self._kp[self._joints], self._kd[self._joints] = contract.kp, contract.kd
        self._scale = np.array(contract.action_scale)
        self._commanded = CommandFeedForward(contract)
        self._readers = [_Reader(contract, terms) for terms in _inputs(contract)]
        self._history = _History(contract)
        self._given: Command | None = None
        self._clear()

    def _clear(self) -> None:
        self._network.reset()
        self._history.reset()
        self._action = np.zeros(len(self._joints))
        self._phase, self._waist, self._posture = np.zeros(1), np.zeros(1), np.zeros((1, 2))
        self.inputs: Sequence[np.ndarray] = ()

    @property
    def phase(self) -> float:
        """Common phase of `hugwbc.gait` in the last control period, in [0, 1); NaN if the policy follows no gait."""
        return float(self._phase[0]) if self.contract.follows_gait else np.nan

    @property
    def stop(self) -> np.ndarray:
        """By how much a stop moves the robot (`hugwbc.controller.Controller`) [m, m, rad], shape (3,)."""
        return np.array(self.contract.stop)

    def reset(self, state: RobotState) -> None:
        """Forget history, recurrent state, last action and clock; a robot that is known to squat keeps its posture."""
        self._clear()
        height = 0.0 if state.position is None else float(state.position[2]) - self.robot.nominal_height
        if _SQUATS < abs(height) < self.robot.nominal_height:
            if self.contract.waist_rate > 0.0:  # at a rate of 0 the command would never turn the waist back
                self._waist[:] = state.q[self.robot.waist]
            self._posture[:] = height, rotations.pitch_of(state.orientation)

    def act(self, state: RobotState, command: Command, upper_body: UpperBody) -> JointCommand:
        """Return joint targets for the next period; arms under external control take their targets.

        An action that is not finite is passed on, so that the guard counts it and holds the last command. It clears the
        network's memory, in which the bad number might remain, and the network does not read it as its last action.
        """
        if command is not self._given:  # most calls repeat the last command
            self._given, self._request = command, self._requested(command)
        gait, asked, told, frequency = self._request
        self._phase = gaits.advance_phase(self._phase, frequency, self.period)
        sensed = self._sensed(state, told, gait, upper_body.indicator)
        observation, *commands = (read(sensed) for read in self._readers)
        self._history.push(observation)
        self.inputs = (self._history.input(), *commands)
        action = self._network(self.inputs)
        clip = self.contract.action_clip
        action = action if clip is None else np.clip(action, -clip, clip)
        if np.isfinite(action).all():
            self._action = action
        else:
            self._network.reset()
        q = self._pose.copy()
        q[self._joints] += self._scale * action
        self._waist, self._posture = self._commanded.follow(self._waist, self._posture, asked)
        q += self._commanded.offsets(self._waist, self._posture, self._phase, gait, asked)[0]
        zero = np.zeros_like(q)
        return override_arms(JointCommand(q, zero, self._kp, self._kd, zero), upper_body, self.robot)

    def _requested(self, command: Command) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray | float]:
        """Return gait, shape (1,), what to ask for and what the network reads of it, (1, 8), and the clock's f [Hz]."""
        gait, given, clock_period = np.array([int(command.gait)]), command.array()[None], self.contract.clock_period
        frequency = given[:, _F] if clock_period is None else 1.0 / clock_period
        asked = self.contract.asked(given, gait)
        return gait, asked, self.contract.read(asked), frequency

    def _sensed(self, state: RobotState, command: np.ndarray, gait: np.ndarray, indicator: bool) -> Sensed:
        velocity = state.velocity
        return Sensed(
            angular_velocity=state.angular_velocity[None],
            gravity=state.projected_gravity[None],
            q=state.q[None],
            dq=state.dq[None],
            action=self._action[None],
            command=command,
            gait=gait,
            phase=self._phase,
            indicator=np.array([indicator]),
            pose=self._pose,
            velocity=None if velocity is None else rotations.rotate_inverse(state.orientation, velocity)[None],
        )


class _Reader:
    """The terms of one input of the network."""

    def __init__(self, contract: Contract, terms: Sequence[Term]) -> None:
        self._limit = contract.observation_clip
        self._parts = [(term, contract.columns(term)) for term in terms]
        scales = [np.broadcast_to(np.asarray(t.scale, dtype=np.float32), contract.size(t)) for t in terms]
        self._scale = np.concatenate(scales)

    def __call__(self, sensed: Sensed) -> np.ndarray:
        """Return what the network reads of one robot, shape (n,), float32."""
        row = scaled(np.concatenate([_value(term, sensed, columns) for term, columns in self._parts]), self._scale)
        return row if self._limit is None else np.clip(row, -self._limit, self._limit)


def _value(term: Term, sensed: Sensed, columns: np.ndarray | None) -> np.ndarray:
    if term.value:
        return np.array(term.value)
    if term.offset:
        sensed = dataclasses.replace(sensed, phase=sensed.phase + term.offset)
    row = TERMS[term.term].read(sensed)[0]
    return row if columns is None else row[columns]


class _History:
    """The last observations, in the arrangement that the network expects."""

    def __init__(self, contract: Contract) -> None:
        self._settings = contract.history
        self._ends = np.cumsum([contract.size(term) for term in contract.observation])[:-1]
        self._size = contract.observation_size
        self.reset()

    def reset(self) -> None:
        """Forget the past."""
        self._frames = np.zeros((self._settings.frames, self._size), dtype=np.float32)
        self.started = False

    def push(self, observation: np.ndarray) -> None:
        """Add the newest observation, shape (observation_size,)."""
        if not self.started and self._settings.start == "first_frame":
            self._frames[:] = observation
        self.started = True
        self._frames = np.concatenate((self._frames[1:], observation[None]))

    def input(self) -> np.ndarray:
        """Return the network's input, shape (frames * observation_size,)."""
        frames = self._frames if self._settings.order == "oldest_first" else self._frames[::-1]
        if self._settings.layout == "by_frame":
            return frames.ravel()
        return np.concatenate([part.ravel() for part in np.split(frames, self._ends, axis=1)])
