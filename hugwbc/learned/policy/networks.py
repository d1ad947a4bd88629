"""The paper's networks: history encoder, state estimator, low-level policy and privileged critic.

The actor has two forms. The plain one is what a policy file holds and what runs on a robot. The symmetric one is
trained: it commutes with the left-right mirror exactly, whatever its weights are, so that what is learnt of a left
step, a left turn or a hop on the left leg is learnt of the right one too. Its linear layers map even to even and odd to
odd coordinates (`hugwbc.learned.policy.symmetry`), which takes half of the products of full matrices. Between layers
the coordinates are turned into pairs (e + o, e - o), which the mirror swaps, so that an activation of each number by
itself commutes with the mirror. `SymmetricActor.plain` multiplies all this out.
"""

import re
from collections.abc import Mapping

import torch
from torch import nn

from hugwbc.learned.policy import critic_observations as obs
from hugwbc.learned.policy.critic_observations import Observation
from hugwbc.learned.policy.symmetry import EvenOdd
from hugwbc.learned.policy.terms import (
    ACTION,
    COMMAND,
    CRITIC_CORE,
    ESTIMATE,
    ESTIMATE_SIZE,
    FRAME,
    HISTORY,
    HISTORY_FRAMES,
    Part,
)
from hugwbc.robot import Robot

_OUTPUT_BOUND = 0.01  # of the last weights of the policy: it starts close to the nominal pose
# Widths of the networks' layers.
_LATENT_SIZE = 32
_ENCODER_HIDDEN = (256, 128)
_ESTIMATOR_HIDDEN = (64, 32)
POLICY_HIDDEN = (512, 256, 128)
_CRITIC_HIDDEN = (512, 256, 128)

# Plain networks ------------------------------------------------------------------------------------------------------


def _mlp(inputs: int, hidden: tuple[int, ...], outputs: int) -> nn.Sequential:
    layers: list[nn.Module] = []
    for width in hidden:
        layers += [nn.Linear(inputs, width), nn.ELU()]
        inputs = width
    return nn.Sequential(*layers, nn.Linear(inputs, outputs))


class Actor(nn.Module):
    """The policy's mean action and state estimate from the proprioceptive history and the command.

    z = encoder(o_his); [v, l, h] = estimator(z); a = policy(z, [v, l, h], o_pro, c). No gradient passes from the
    policy to the estimate: its own loss alone trains it, so that it remains an estimate of the state.

    Attributes:
        frame_size: width of a proprioceptive frame, 63 for the H1.
        command_size: width of the command observation, 18 without further terms.
        action_size: number of joints.
    """

    def __init__(
        self, frame_size: int, command_size: int, action_size: int, hidden: tuple[int, ...] = POLICY_HIDDEN
    ) -> None:
        """Set up the layers; `hidden` are the widths of the policy's hidden layers."""
        super().__init__()
        self.frame_size, self.command_size, self.action_size = frame_size, command_size, action_size
        self.encoder = _mlp(HISTORY_FRAMES * frame_size, _ENCODER_HIDDEN, _LATENT_SIZE)
        self.estimator = _mlp(_LATENT_SIZE, _ESTIMATOR_HIDDEN, ESTIMATE_SIZE)
        self.policy = _mlp(_LATENT_SIZE + ESTIMATE_SIZE + frame_size + command_size, hidden, action_size)

    def forward(self, history: torch.Tensor, command: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return mean action and estimate.

        Args:
            history: the last five proprioceptive frames, oldest first, shape (n, 5 frame_size).
            command: commands, gait, clocks and indicator, shape (n, 18), then further terms.

        Returns:
            Mean action, shape (n, joints), and estimate [v, l, h] in observation units, shape (n, 6).
        """
        latent = self.encoder(history)
        estimate = self.estimator(latent)
        newest = history[:, -self.frame_size :]
        return self.policy(torch.cat((latent, estimate.detach(), newest, command), dim=1)), estimate


# Symmetric networks --------------------------------------------------------------------------------------------------


class SplitLinear(nn.Module):
    """A linear layer that commutes with the mirror: even coordinates from even ones, odd from odd ones.

    Attributes:
        even, odd: the two parts; a bias of the odd part would not change its sign in the mirror, so there is none.
    """

    def __init__(self, inputs: tuple[int, int], outputs: tuple[int, int], gain: float = 1.0) -> None:
        """Draw weights as torch does, times a gain; inputs and outputs are numbers of even and odd coordinates."""
        super().__init__()
        self.even = nn.Linear(inputs[0], outputs[0])
        self.odd = nn.Linear(inputs[1], outputs[1], bias=False)
        with torch.no_grad():
            self.even.weight.mul_(gain)
            self.odd.weight.mul_(gain)

    def forward(self, even: torch.Tensor, odd: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Map even and odd coordinates."""
        return self.even(even), self.odd(odd)

    def matrix(self) -> torch.Tensor:
        """Return the weights as one matrix, with zeros between even and odd."""
        return torch.block_diag(self.even.weight.detach(), self.odd.weight.detach())

    def bias(self) -> torch.Tensor:
        """Return the bias of all outputs."""
        return torch.cat((self.even.bias.detach(), torch.zeros(self.odd.out_features)))


def _activate(even: torch.Tensor, odd: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    first, second = nn.functional.elu(even + odd), nn.functional.elu(even - odd)
    return first + second, first - second


def _pairs(width: int) -> torch.Tensor:
    """Return the matrix from `width` even and odd coordinates (e, o) to pairs (e + o, e - o); twice gives 2 (e, o)."""
    one = torch.eye(width // 2)
    return torch.cat((torch.cat((one, one), 1), torch.cat((one, -one), 1)))


class SplitMlp(nn.Module):
    """Linear layers that commute with the mirror, and activations of pairs between them."""

    def __init__(
        self, inputs: tuple[int, int], hidden: tuple[int, ...], outputs: tuple[int, int] | None = None
    ) -> None:
        """Set up the layers.

        Args:
            inputs: numbers of even and odd coordinates.
            hidden: widths of the equivalent plain network.
            outputs: numbers of even and odd coordinates that come out; None to end in a hidden layer.
        """
        super().__init__()
        layers: list[SplitLinear] = []
        # e and o each have the variance of a full layer's output, so that their sum and difference have twice of it,
        # before an activation and again after it. The gains undo this.
        for width in hidden:
            layers.append(SplitLinear(inputs, (width // 2, width // 2), gain=0.5 if layers else 0.5**0.5))
            inputs = (width // 2, width // 2)
        if outputs is not None:
            layers.append(SplitLinear(inputs, outputs, gain=0.5**0.5))
        self.layers = nn.ModuleList(layers)

    def forward(self, even: torch.Tensor, odd: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Map even and odd coordinates of rows to those of the outputs."""
        *hidden, last = self.layers
        for layer in hidden:
            even, odd = _activate(*layer(even, odd))
        return last(even, odd)

    def write_to(self, plain: nn.Sequential, inputs: torch.Tensor, outputs: torch.Tensor) -> None:
        """Write the equivalent weights into a plain network.

        Args:
            plain: network of the same widths.
            inputs: matrix from the plain inputs to their even and odd coordinates.
            outputs: matrix from the even and odd coordinates of the outputs to the plain outputs.
        """
        linear = [layer for layer in plain if isinstance(layer, nn.Linear)]
        before = inputs
        for k, (layer, target) in enumerate(zip(self.layers, linear, strict=True)):
            assert isinstance(layer, SplitLinear)
            after = outputs if k == len(linear) - 1 else _pairs(target.out_features)
            target.weight.data.copy_(after @ layer.matrix() @ before)
            target.bias.data.copy_(after @ layer.bias())
            before = _pairs(target.out_features) if k < len(linear) - 1 else before


class SymmetricActor(nn.Module):
    """`Actor` with pi(F o) = F pi(o), where F is the mirror map of observations or actions."""

    def __init__(self, robot: Robot, further: tuple[Part, ...] = (), hidden: tuple[int, ...] = POLICY_HIDDEN) -> None:
        """Set up the layers for a robot, with further inputs for further observation terms.

        Args:
            robot: the robot.
            further: the further observation terms.
            hidden: widths of the policy's hidden layers.
        """
        super().__init__()
        self._hidden = hidden
        parts = (HISTORY, (*COMMAND, *further), FRAME, ACTION, ESTIMATE)
        splits = [EvenOdd(obs.mirror(part, robot)) for part in parts]
        self._history, self._command, self._frame, self._action, self._estimate = splits
        half = _LATENT_SIZE // 2
        parts = (self._estimate, self._frame, self._command)
        state = (half + sum(part.even for part in parts), half + sum(part.odd for part in parts))
        self.encoder = SplitMlp(_sizes(self._history), _ENCODER_HIDDEN, (half, half))
        self.estimator = SplitMlp((half, half), _ESTIMATOR_HIDDEN, _sizes(self._estimate))
        self.policy = SplitMlp(state, hidden, _sizes(self._action))

    def forward(self, history: torch.Tensor, command: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return mean action and estimate, as `Actor.forward`."""
        return self.prepared(self._history(history), self._command(command))

    def prepared(self, history: torch.Tensor, command: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return mean action and estimate from even and odd coordinates of history and command."""
        history_even, history_odd = history.split(_sizes(self._history), 1)
        command_even, command_odd = command.split(_sizes(self._command), 1)
        latent_even, latent_odd = self.encoder(history_even, history_odd)
        estimate_even, estimate_odd = self.estimator(latent_even, latent_odd)
        # The newest frame is the last in both parts.
        even = (latent_even, estimate_even.detach(), history_even[:, -self._frame.even :], command_even)
        odd = (latent_odd, estimate_odd.detach(), history_odd[:, -self._frame.odd :], command_odd)
        action = self.policy(torch.cat(even, 1), torch.cat(odd, 1))
        estimate = torch.cat((estimate_even, estimate_odd), 1)
        return self._action.inverse(torch.cat(action, 1)), self._estimate.inverse(estimate)

    def plain(self) -> Actor:
        """Return the equivalent plain network."""
        frame, command, action = (len(part.matrix) for part in (self._frame, self._command, self._action))
        actor = Actor(frame, command, action, self._hidden)
        latent = torch.eye(_LATENT_SIZE)
        self.encoder.write_to(actor.encoder, self._history.matrix, latent)
        self.estimator.write_to(actor.estimator, latent, self._estimate.matrix.T)
        parts = [latent, self._estimate.matrix, self._frame.matrix, self._command.matrix]
        evens = [_LATENT_SIZE // 2, self._estimate.even, self._frame.even, self._command.even]
        even = torch.block_diag(*[part[:n] for part, n in zip(parts, evens, strict=True)])
        odd = torch.block_diag(*[part[n:] for part, n in zip(parts, evens, strict=True)])
        self.policy.write_to(actor.policy, torch.cat((even, odd)), self._action.matrix.T)
        return actor


class SymmetricCritic(nn.Module):
    """The value of a privileged observation, shape (n, size), with V(F o) = V(o) for the mirror map F."""

    def __init__(self, robot: Robot, further: tuple[Part, ...] = ()) -> None:
        """Set up the layers for a robot, with further inputs for further observation terms."""
        super().__init__()
        self._core = EvenOdd(obs.mirror((*CRITIC_CORE, *further), robot))
        self._terrain = EvenOdd(obs.terrain_mirror())
        inputs = (self._core.even + self._terrain.even, self._core.odd + self._terrain.odd)
        self.value = SplitMlp(inputs, _CRITIC_HIDDEN)
        self.output = nn.Linear(_CRITIC_HIDDEN[-1] // 2, 1)  # an odd part would change the sign of the value
        # Of equal samples, an even coordinate is one sample times the sum of its row of the matrix; odd ones are 0.
        self.register_buffer("_flat", self._terrain.matrix.sum(1)[: self._terrain.even, None], persistent=False)

    def prepare(self, observation: torch.Tensor) -> torch.Tensor:
        """Return the coordinates of an observation: even, odd, then those of the terrain, or its one number."""
        size = len(self._core.matrix)
        core, terrain = observation[:, :size], observation[:, size:]
        return torch.cat((self._core(core), terrain if terrain.shape[1] == 1 else self._terrain(terrain)), 1)

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Return the value of each row, shape (n,)."""
        return self.prepared(self.prepare(observation))

    def prepared(self, observation: torch.Tensor) -> torch.Tensor:
        """Return the values of coordinates that `prepare` returned, shape (n,)."""
        core, odd, terrain = observation.split(
            (self._core.even, self._core.odd, observation.shape[1] - len(self._core.matrix)), 1
        )
        first, *hidden = self.value.layers
        if terrain.shape[1] == 1:
            even, odd = self._first_on_a_plane(torch.cat((core, terrain), 1), odd)
        else:
            heights = terrain.split(_sizes(self._terrain), 1)
            even, odd = first(torch.cat((core, heights[0]), 1), torch.cat((odd, heights[1]), 1))
        even, odd = _activate(even, odd)
        for layer in hidden:
            even, odd = _activate(*layer(even, odd))
        return self.output(even).squeeze(1)

    def _first_on_a_plane(self, even: torch.Tensor, odd: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        layer = self.value.layers[0]
        assert isinstance(layer, SplitLinear) and isinstance(self._flat, torch.Tensor)
        core, terrain = layer.even.weight.split((self._core.even, self._terrain.even), 1)
        weight = torch.cat((core, terrain @ self._flat), 1)
        first = nn.functional.linear(even, weight, layer.even.bias)
        return first, nn.functional.linear(odd, layer.odd.weight[:, : self._core.odd])


def _sizes(split: EvenOdd) -> tuple[int, int]:
    return split.even, split.odd


# Learner -------------------------------------------------------------------------------------------------------------


class ActorCritic(nn.Module):
    """Actor, critic and one exploration standard deviation per joint; joints that are mirror images share theirs.

    Attributes:
        core: numbers of even and of odd coordinates of `CRITIC_CORE`.
        further: numbers of even and of odd coordinates of the further observation terms that the networks read.
    """

    _partner: torch.Tensor  # of each joint, in the mirror

    def __init__(
        self,
        robot: Robot,
        std: float = 1.0,
        *,
        further: tuple[Part, ...] = (),
        hidden: tuple[int, ...] = POLICY_HIDDEN,
    ) -> None:
        """Draw the weights for a robot, and set the std of all joints."""
        super().__init__()
        self.actor, self.critic = SymmetricActor(robot, further, hidden), SymmetricCritic(robot, further)
        self.core = _sizes(EvenOdd(obs.mirror(CRITIC_CORE, robot)))
        even, odd = _sizes(self.critic._core)
        self.further = even - self.core[0], odd - self.core[1]
        self.register_buffer("_partner", obs.mirror(ACTION, robot).index.clone(), persistent=False)
        self.log_std = nn.Parameter(torch.full((len(robot.joint_names),), float(std)).log())
        last = self.actor.policy.layers[-1]
        assert isinstance(last, SplitLinear)
        for linear in (last.even, last.odd):
            nn.init.uniform_(linear.weight, -_OUTPUT_BOUND, _OUTPUT_BOUND)
        nn.init.zeros_(last.even.bias)

    def exploration(self) -> torch.Tensor:
        """Return the log of the standard deviation of every joint, shape (joints,)."""
        return 0.5 * (self.log_std + self.log_std[self._partner])

    def prepare(self, observation: Observation) -> Observation:
        """Return an observation in the coordinates in which `prepared` of actor and critic read it."""
        return Observation(
            self.actor._history(observation.history),
            self.actor._command(observation.command),
            self.critic.prepare(observation.critic),
            observation.estimate,
        )


def policy_widths(tensors: Mapping[str, torch.Tensor]) -> tuple[int, ...]:
    """Return the widths of the policy's hidden layers, from tensors of a plain or a symmetric actor, by name.

    Files may hold policies half as wide as new ones. Without such tensors, return `POLICY_HIDDEN`.
    """
    plain = [name for name in sorted(tensors) if re.fullmatch(r"policy\.\d\.bias", name)]
    split = [name for name in sorted(tensors) if re.fullmatch(r"network\.actor\.policy\.layers\.\d\.even\.bias", name)]
    widths = [tensors[name].numel() for name in plain] + [2 * tensors[name].numel() for name in split]
    return tuple(widths[:-1]) or POLICY_HIDDEN


def load_into(network: ActorCritic, tensors: Mapping[str, torch.Tensor]) -> None:
    """Load tensors, by their names in the network.

    Observation terms that the tensors' network did not read get weights of zero.
    """
    widened = _widened(network, tensors) if any(network.further) else {}
    network.load_state_dict(dict(tensors) | widened)


def _widened(network: ActorCritic, tensors: Mapping[str, torch.Tensor]) -> dict[str, torch.Tensor]:
    """Return the first layers' weights with zeros inserted for further terms, without those that fit already."""
    even, odd = network.further
    places = {
        "actor.policy.layers.0.even.weight": (None, even),
        "actor.policy.layers.0.odd.weight": (None, odd),
        "critic.value.layers.0.even.weight": (network.core[0], even),
        "critic.value.layers.0.odd.weight": (network.core[1], odd),
    }
    wide, wanted = {}, network.state_dict()
    for name, (place, count) in places.items():
        weight = tensors[name]
        if weight.shape[1] + count == wanted[name].shape[1] and count:
            place = weight.shape[1] if place is None else place
            wide[name] = torch.cat((weight[:, :place], weight.new_zeros(len(weight), count), weight[:, place:]), 1)
    return wide
