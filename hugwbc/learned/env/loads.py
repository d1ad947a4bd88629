"""Loads of the training robots: masses in the hands, forces on the hands, pushes of the trunk."""

import math

import torch

from hugwbc import rotations
from hugwbc.learned.config import LoadConfig
from hugwbc.learned.env.randomization import rand, randint, randn, uniform
from hugwbc.learned.env.readings import to_heading
from hugwbc.robot import SIDES, Robot
from hugwbc.sim.batch import RobotBatch

_HANDS = len(SIDES)
_STATE = ("payload", "hand_force", "hand_time", "trunk_force", "trunk_time")


class Loads:
    """What n robots carry and what pulls and pushes them.

    A payload is a point mass in a hand: it changes mass, centre and inertia of the forearm. A force has a fixed
    direction in the world.

    Attributes:
        config: the largest values, which may change between steps.
        payload: mass in each hand [kg], shape (n, 2).
        hand_force: force on each hand in the world [N], shape (n, 2, 3).
        hand_time: time for which it still acts [s]; below 0 there is none, shape (n,).
        trunk_force: force on the trunk in the world [N], shape (n, 3).
        trunk_time: time for which it still acts [s], shape (n,).
    """

    def __init__(
        self,
        simulation: RobotBatch,
        robot: Robot,
        config: LoadConfig,
        eligible: torch.Tensor,
        generator: torch.Generator,
        dt: float,
    ) -> None:
        """Take the robots without loads, which of them may have some, (n,), bool, and the control period `dt` [s]."""
        self.config, self._eligible, self._generator, self._dt = config, eligible, generator, dt
        self._simulation, count, device = simulation, simulation.count, simulation.device
        self._forearms = torch.tensor([simulation.model.body(link).id for link in robot.hand_links], device=device)
        self._trunk = simulation.model.body(robot.trunk).id
        self._hands = torch.tensor(robot.hands, dtype=torch.float64, device=device)
        self._empty: tuple[torch.Tensor, ...] | None = None
        self._pulled = False
        self.payload = torch.zeros(count, _HANDS, device=device)
        self.hand_force, self.trunk_force = self.payload.new_zeros(count, _HANDS, 3), self.payload.new_zeros(count, 3)
        self.hand_time, self.trunk_time = torch.full((2, count), -1.0, device=device)

    # Payloads -------------------------------------------------------------------------------------------------------

    def reset(self, robots: torch.Tensor, hopping: torch.Tensor) -> None:
        """End the forces on robots (indices), and draw payloads of new episodes; robots that hop, (k,), get none."""
        self.hand_time[robots], self.trunk_time[robots] = -1.0, -1.0
        self.hand_force[robots], self.trunk_force[robots] = 0.0, 0.0
        if self.config.payload == 0.0 and not bool(self.payload[robots].any()):
            return
        count = robots.numel()
        loaded = rand(self._generator, count) < self.config.loaded_share
        mass = self.config.payload * rand(self._generator, count, _HANDS)
        self.payload[robots] = mass * (loaded & self._eligible[robots] & ~hopping)[:, None]
        self._write_payload(robots)

    def _write_payload(self, ids: torch.Tensor) -> None:
        """Put the payloads of robots (indices) into the model of each."""
        simulation, arms = self._simulation, self._forearms
        fields = [simulation.expand(name) for name in ("body_mass", "body_ipos", "body_inertia")]
        if self._empty is None:
            without = [field[:, arms].double() for field in fields]
            to_hand = self._hands - without[1]
            # Along the principal axes of the forearm, whose directions are kept.
            axes = simulation.model.body_iquat[arms.numpy(force=True)]
            lever = torch.as_tensor(rotations.rotate_inverse(axes, to_hand.numpy(force=True)), device=arms.device)
            self._empty = *without, to_hand, lever**2
        mass, centre, inertia, to_hand, squares = (part[ids] for part in self._empty)
        load = self.payload[ids].double()
        total = mass + load
        # The reduced mass of two point masses, for their inertia about the common centre.
        reduced = (mass * load / total)[..., None]
        inertia = inertia + reduced * (squares.sum(-1, keepdim=True) - squares)
        for field, values in zip(fields, (total, centre + (load / total)[..., None] * to_hand, inertia), strict=True):
            field[ids[:, None], arms] = values.to(field)
        simulation.set_const(ids)

    # Forces ---------------------------------------------------------------------------------------------------------

    def step(self, hopping: torch.Tensor) -> None:
        """Let forces begin and end, and apply them in the coming control step; robots that hop, (n,), have none."""
        c = self.config
        if c.hand_force > 0.0:
            begun = self._advance(self.hand_time, c.hand_interval, c.hand_time, hopping)
            count = begun.numel()
            direction = torch.nn.functional.normalize(randn(self._generator, count, _HANDS, 3), dim=2)
            # Each hand alone and both together, a third of the time each.
            which = randint(self._generator, 3, count, 1)
            pulled = torch.cat((which != 1, which != 0), dim=1)
            force = c.hand_force * rand(self._generator, count, _HANDS) * pulled
            self.hand_force[begun] = force[..., None] * direction
        else:
            self.hand_time[:] = -1.0
        if c.trunk_force > 0.0:
            begun = self._advance(self.trunk_time, c.trunk_interval, c.trunk_time, hopping)
            angle = uniform(self._generator, begun.numel(), -math.pi, math.pi)
            force = uniform(self._generator, begun.numel(), 0.0, c.trunk_force)
            level = torch.stack((angle.cos(), angle.sin(), torch.zeros_like(angle)), dim=1)
            self.trunk_force[begun] = force[:, None] * level
        else:
            self.trunk_time[:] = -1.0
        self.hand_force.masked_fill_((self.hand_time < 0.0)[:, None, None], 0.0)
        self.trunk_force.masked_fill_((self.trunk_time < 0.0)[:, None], 0.0)
        self._apply()

    def _advance(
        self, left: torch.Tensor, interval: float, duration: tuple[float, float], hopping: torch.Tensor
    ) -> torch.Tensor:
        """Advance the times that are left, in place; return the robots, as indices, on which a force begins."""
        left -= self._dt
        left[hopping] = -1.0
        free = (left < 0.0) & self._eligible & ~hopping
        begins = free & (rand(self._generator, *left.shape) < self._dt / interval)
        begun = begins.nonzero().squeeze(1)
        left[begun] = uniform(self._generator, begun.numel(), *duration)
        return begun

    def _apply(self) -> None:
        """Write the forces of the next control step, with the torque that a force on a hand has about the forearm."""
        pulled = bool(self.hand_force.any() | self.trunk_force.any())
        if not (pulled or self._pulled):
            return
        self._pulled = pulled
        position, matrix, centre = (field[:, self._forearms] for field in self._simulation.link_poses())
        lever = position + torch.einsum("nbij,bj->nbi", matrix, self._hands.to(matrix)) - centre
        forces = self._simulation.forces
        force = self.hand_force.to(forces)
        forces[:, self._forearms, :3] = force
        forces[:, self._forearms, 3:] = rotations.cross(lever, force)
        forces[:, self._trunk, :3] = self.trunk_force.to(forces)

    def observation(self, heading: torch.Tensor) -> torch.Tensor:
        """Return payloads [kg] and forces in the heading frame [N]: of both hands, then the trunk's, shape (n, 11)."""
        forces = torch.cat((self.hand_force, self.trunk_force[:, None]), dim=1)
        return torch.cat((self.payload, to_heading(forces, heading[:, None]).flatten(1)), dim=1)

    # Checkpointing --------------------------------------------------------------------------------------------------

    def state_dict(self) -> dict[str, torch.Tensor]:
        """Return everything that a resumed run needs."""
        return {name: getattr(self, name) for name in _STATE}

    def load_state_dict(self, state: dict[str, torch.Tensor]) -> None:
        """Restore what `state_dict` returned."""
        for name, value in state.items():
            setattr(self, name, value.clone())
        if self._empty is not None or bool(self.payload.any()):
            self._write_payload(torch.arange(len(self.payload), device=self.payload.device))
