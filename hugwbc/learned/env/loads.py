"""Loads of the training robots: masses in the hands, forces on the hands, pushes of the trunk."""

import numpy as np
import torch

from hugwbc import rotations
from hugwbc.learned.config import LoadConfig
from hugwbc.learned.env.command_sampling import uniform
from hugwbc.robot import SIDES, Robot
from hugwbc.sim.batch import BatchSimulation

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
        simulation: BatchSimulation,
        robot: Robot,
        config: LoadConfig,
        eligible: torch.Tensor,
        generator: torch.Generator,
        dt: float,
    ) -> None:
        """Take the robots as they are without loads.

        Args:
            simulation: the robots, with their own model parameters.
            robot: the robot as described.
            config: the largest values.
            eligible: which robots may be loaded, shape (n,), bool.
            generator: source of the draws.
            dt: control period [s].
        """
        self.config, self._eligible, self._generator, self._dt = config, eligible, generator, dt
        self._simulation, count = simulation, simulation.count
        self._forearms = np.array([simulation.model.body(f"{side}_elbow_link").id for side in SIDES])
        self._trunk = simulation.model.body("torso_link").id
        self._hand = np.array(robot.hand)
        self._empty: dict[str, np.ndarray] | None = None
        self._poses: tuple[np.ndarray, ...] | None = None
        self._pulled = False
        self.payload = torch.zeros(count, _HANDS)
        self.hand_force, self.hand_time = torch.zeros(count, _HANDS, 3), torch.full((count,), -1.0)
        self.trunk_force, self.trunk_time = torch.zeros(count, 3), torch.full((count,), -1.0)

    # Payloads -------------------------------------------------------------------------------------------------------

    def reset(self, robots: torch.Tensor) -> None:
        """End the forces on robots (indices) and draw what they carry in a new episode."""
        self.hand_time[robots], self.trunk_time[robots] = -1.0, -1.0
        self.hand_force[robots], self.trunk_force[robots] = 0.0, 0.0
        if self.config.payload == 0.0 and not bool(self.payload[robots].any()):
            return
        count = robots.numel()
        loaded = torch.rand(count, generator=self._generator) < self.config.loaded_share
        mass = self.config.payload * torch.rand((count, _HANDS), generator=self._generator)
        self.payload[robots] = mass * (loaded & self._eligible[robots])[:, None]
        self._write_payload(robots.numpy())

    def _write_payload(self, ids: np.ndarray) -> None:
        """Put the payloads of robots (indices) into the model of each."""
        batch, arms = self._simulation.batch, self._forearms
        fields = {name: batch.expand(name) for name in ("body_mass", "body_ipos", "body_inertia")}
        if self._empty is None:
            self._empty = {name: values[:, arms].copy() for name, values in fields.items()}
        mass, centre, inertia = (self._empty[name][ids] for name in fields)
        load = self.payload[ids].double().numpy()
        total = mass + load
        to_hand = self._hand - centre
        rows = ids[:, None], arms[None]
        fields["body_mass"][rows] = total
        fields["body_ipos"][rows] = centre + (load / total)[..., None] * to_hand
        # Of two point masses about their common centre, along the principal axes of the forearm, which stay.
        lever = rotations.rotate_inverse(self._simulation.model.body_iquat[arms], to_hand)
        reduced = (mass * load / total)[..., None]
        fields["body_inertia"][rows] = inertia + reduced * ((lever**2).sum(-1, keepdims=True) - lever**2)
        batch.set_const(ids=ids)

    # Forces ---------------------------------------------------------------------------------------------------------

    def step(self, hopping: torch.Tensor) -> None:
        """Let forces begin and end, and apply them in the next control step; hopping robots, (n,), bool, have none."""
        c = self.config
        if c.hand_force > 0.0:
            begun = self._advance(self.hand_time, c.hand_interval, c.hand_time, hopping)
            count = begun.numel()
            direction = torch.nn.functional.normalize(torch.randn((count, _HANDS, 3), generator=self._generator), dim=2)
            # Each hand alone and both together, a third of the time each.
            which = torch.randint(3, (count, 1), generator=self._generator)
            pulled = torch.cat((which != 1, which != 0), dim=1)
            force = c.hand_force * torch.rand((count, _HANDS), generator=self._generator) * pulled
            self.hand_force[begun] = force[..., None] * direction
        if c.trunk_force > 0.0:
            begun = self._advance(self.trunk_time, c.trunk_interval, c.trunk_time, hopping)
            angle = uniform(self._generator, begun.numel(), -np.pi, np.pi)
            force = uniform(self._generator, begun.numel(), 0.0, c.trunk_force)
            level = torch.stack((angle.cos(), angle.sin(), torch.zeros_like(angle)), dim=1)
            self.trunk_force[begun] = force[:, None] * level
        self.hand_force[self.hand_time < 0.0] = 0.0
        self.trunk_force[self.trunk_time < 0.0] = 0.0
        self._apply()

    def _advance(
        self, left: torch.Tensor, interval: float, duration: tuple[float, float], hopping: torch.Tensor
    ) -> torch.Tensor:
        """Advance the times that are left, in place; return the robots, as indices, on which a force begins."""
        left -= self._dt
        left[hopping] = -1.0
        free = (left < 0.0) & self._eligible & ~hopping
        begins = free & (torch.rand(left.shape, generator=self._generator) < self._dt / interval)
        begun = begins.nonzero().squeeze(1)
        left[begun] = uniform(self._generator, begun.numel(), *duration)
        return begun

    def _apply(self) -> None:
        """Write the forces of the next control step, with the torque that a force on a hand has about the forearm."""
        pulled = bool(self.hand_force.any()) or bool(self.trunk_force.any())
        if not (pulled or self._pulled):
            return
        self._pulled = pulled
        batch = self._simulation.batch
        if self._poses is None:
            self._poses = tuple(batch.bind(name) for name in ("xpos", "xmat", "xipos"))
            batch.forward()  # a field is filled by the next call
        position, matrix, centre = (field[:, self._forearms] for field in self._poses)
        hand = position + np.einsum("nbij,j->nbi", matrix.reshape(*matrix.shape[:2], 3, 3), self._hand)
        forces = self._simulation.forces
        force = self.hand_force.double().numpy()
        forces[:, self._forearms, :3] = force
        forces[:, self._forearms, 3:] = np.cross(hand - centre, force)
        forces[:, self._trunk, :3] = self.trunk_force.double().numpy()

    def observation(self, heading: torch.Tensor) -> torch.Tensor:
        """Return payloads [kg] and forces in the heading frame [N]: of both hands, then the trunk's, shape (n, 11).

        Args:
            heading: yaw of the pelvises [rad], shape (n,).
        """
        forces = torch.cat((self.hand_force, self.trunk_force[:, None]), dim=1)
        cos, sin = heading.cos()[:, None], heading.sin()[:, None]
        x, y, z = forces.unbind(2)
        turned = torch.stack((cos * x + sin * y, cos * y - sin * x, z), dim=2)
        return torch.cat((self.payload, turned.flatten(1)), dim=1)

    # Checkpointing --------------------------------------------------------------------------------------------------

    def state_dict(self) -> dict[str, torch.Tensor]:
        """Return everything that a resumed run needs."""
        return {name: getattr(self, name) for name in _STATE}

    def load_state_dict(self, state: dict[str, torch.Tensor]) -> None:
        """Restore what `state_dict` returned; an empty state leaves the robots without loads."""
        for name, value in state.items():
            setattr(self, name, value.clone())
        if state and (self._empty is not None or bool(self.payload.any())):
            self._write_payload(np.arange(len(self.payload)))
