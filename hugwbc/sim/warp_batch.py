"""Many robots at once on MuJoCo Warp: the engine of an NVIDIA GPU; on the processor it is slow, and serves tests.

MuJoCo Warp recomputes all robots or none: what a reset of some would change in the others is put back. It computes the
poses of the world's geoms only once, so the plane below the feet is moved by hand. Contacts beyond the memory set aside
for them are dropped without a message: `faults` counts the robots.
"""

import contextlib
import functools
from collections.abc import Iterator
from typing import Any

import mujoco
import mujoco_warp as mjw  # pyright: ignore[reportMissingImports]
import numpy as np
import torch
import warp as wp  # pyright: ignore[reportMissingImports]

from hugwbc.sim.batch import RobotBatch
from hugwbc.sim.footing import Footing

CONTACTS = 24  # for each robot on average; a walking one has 8
ROWS = 128  # of constraints for each robot: 19 of friction, 4 of a contact, limits of joints; a walking one has 60
_LARGEST = 1e10  # beyond which MuJoCo calls a state diverged
_SOLVER = mjw.OverflowType.ITERATIONS | mjw.OverflowType.LS_ITERATIONS  # out of iterations: no fault in MuJoCo either
_DERIVED = ("body_subtreemass", "body_invweight0", "dof_invweight0", "actuator_acc0")


@wp.kernel
def _drive(
    targets: wp.array3d[float],
    substep: int,
    joints: wp.array[int],
    limit: wp.array2d[float],
    slope: wp.array[float],
    reserve: wp.array[float],
    limited: bool,
    velocity: wp.array2d[float],
    ctrl: wp.array2d[float],
    force_range: wp.array2d[wp.vec2],
) -> None:
    """Write the targets of a physics step, and the range of the torque as `TorqueSpeedLimit` does."""
    world, joint = wp.tid()
    ctrl[world, joint] = targets[substep, world, joint]
    if limited:
        share = velocity[world, joints[joint]] * slope[joint]
        low, high = wp.clamp(reserve[joint] + share, 0.0, 1.0), wp.clamp(reserve[joint] - share, 0.0, 1.0)
        if not wp.isfinite(share):  # of a diverged robot
            low, high = 1.0, 1.0
        force_range[world, joint] = wp.vec2(-limit[world, joint] * low, limit[world, joint] * high)


class WarpBatch(RobotBatch):
    """The robots on MuJoCo Warp, in single precision; the tensors are views of Warp's arrays."""

    def __init__(self, count: int, *, device: str = "cuda", contacts: int = CONTACTS, **settings: Any) -> None:  # noqa: ANN401
        """Build the batch; the first one compiles for about a minute, the next ones find that in a cache.

        There is memory for `contacts` contacts per robot on average. The settings are those of `RobotBatch`.
        """
        super().__init__(count, **settings)
        # Warp has no midphase to switch off. Without native convex collision it takes MuJoCo's test of two boxes.
        flags = self.model.opt.disableflags & ~int(mujoco.mjtDisableBit.mjDSBL_MIDPHASE)
        self.model.opt.disableflags = flags | int(mujoco.mjtDisableBit.mjDSBL_NATIVECCD)
        wp.init()
        self._place = torch.device(device)
        self._device = wp.device_from_torch(self._place)
        with self._running():
            self._model = mjw.put_model(self.model)
            self._data = mjw.make_data(self.model, nworld=count, nconmax=contacts, njmax=ROWS)
        self._model.opt.warn_overflow = 0  # no lines from kernels
        d, layout = self._data, self.layout
        self.graphs = self._device.is_cuda  # whether a control step is one CUDA graph instead of single kernels
        self._graph: wp.Graph | None = None
        self.qpos, self.qvel = wp.to_torch(d.qpos)[:, layout.qpos], wp.to_torch(d.qvel)[:, layout.qvel]
        self.ctrl, self.forces = wp.to_torch(d.ctrl)[:, layout.ctrl], wp.to_torch(d.xfrc_applied)
        self.warm_start = wp.to_torch(d.qacc_warmstart)
        self.torque, self._sensors = torch.zeros_like(self.ctrl), wp.to_torch(d.sensordata)
        self._force_sensors = torch.zeros_like(self._sensors)
        self._index_sensors()
        self._targets = self.ctrl.new_zeros(0, *self.ctrl.shape)
        slope = 1.0 / (self.robot.velocity_limit - self.robot.corner_speed)
        with self._running():
            self._slope, self._reserve = (wp.array(v, dtype=float) for v in (slope, self.robot.velocity_limit * slope))
            self._joints = wp.array(np.arange(self.model.nv)[layout.rates], dtype=int)
        self._footing, self._geom_pos = None, self.expand("geom_pos")
        if self.terrain is not None:
            place = functools.partial(torch.as_tensor, device=self.device)
            self._footing = Footing(self.model, self.terrain, place)
        key = self.model.key("nominal")
        self.qpos[:], self.ctrl[:] = self.tensor(key.qpos[layout.qpos]), self.tensor(key.ctrl[layout.ctrl])
        self.forward(torch.arange(count, device=self.device))

    def expand(self, name: str) -> torch.Tensor:  # noqa: D102
        field = getattr(self._model, name)
        if field.shape[0] != self.count:
            values = np.repeat(field.numpy()[:1], self.count, axis=0)
            with self._running():
                setattr(self._model, name, wp.array(values, dtype=field.dtype))
            self._graph = None  # it refers to the old array
        return wp.to_torch(getattr(self._model, name))

    def set_const(self, ids: torch.Tensor | None = None) -> None:
        """Recompute what depends on masses, of all robots."""
        for name in _DERIVED:
            self.expand(name)
        with self._running():
            mjw.set_const(self._model, self._data)

    @contextlib.contextmanager
    def _running(self) -> Iterator[None]:
        """Let Warp's kernels run in order with torch's."""
        stream = wp.stream_from_torch(torch.cuda.current_stream(self._place)) if self._device.is_cuda else None
        with wp.ScopedDevice(self._device), wp.ScopedStream(stream):
            yield

    def step(self, substeps: int, targets: torch.Tensor | None = None) -> torch.Tensor:
        """Advance all robots; return which diverged."""
        if len(self._targets) != substeps:
            self._targets, self._graph = self.ctrl.new_zeros(substeps, *self.ctrl.shape), None
        self._targets[:] = self.ctrl if targets is None else targets
        self._place_feet()
        with self._running():
            if self._graph is None:
                self._launch()  # this compiles kernels, where needed
            else:
                wp.capture_launch(self._graph)
        if self.graphs and self._graph is None:
            # On a stream of Warp's: torch's default stream cannot be captured. A capture computes nothing.
            torch.cuda.synchronize(self.device)
            with wp.ScopedDevice(self._device), wp.ScopedCapture() as capture:
                self._launch()
            self._graph = capture.graph
        state = torch.cat((self.qpos, self.qvel, self.warm_start, self.ctrl), 1)
        return ~(state.abs() < _LARGEST).all(1)  # NaN counts as diverged

    @functools.cached_property
    def _limit(self) -> torch.Tensor:
        """The torque limits of the first step, after a randomisation [N m], shape (robots, joints)."""
        return self.expand("actuator_forcerange")[..., 1].clone()

    def _launch(self) -> None:
        """Launch the kernels of a control step; stages of position and velocity are up to date before and after."""
        m, d = self._model, self._data
        limit, targets = wp.from_torch(self._limit), wp.from_torch(self._targets)
        last = len(self._targets) - 1
        if self._footing is not None:  # the contacts of the first physics step, with the feet where they are now
            mjw.step1(m, d)
        for substep in range(last + 1):
            inputs = [targets, substep, self._joints, limit, self._slope, self._reserve, self._limited, d.qvel]
            wp.launch(_drive, (self.count, m.nu), inputs=inputs, outputs=[d.ctrl, m.actuator_forcerange])
            m.opt.disableflags |= mjw.DisableBit.SENSOR  # computed in the last physics step alone
            if substep == last:
                m.opt.disableflags &= ~mjw.DisableBit.SENSOR
            mjw.step2(m, d)
            if substep == last:  # the next stage of positions clears the sensors
                wp.copy(wp.from_torch(self._force_sensors), d.sensordata)
                wp.copy(wp.from_torch(self.torque), d.actuator_force)
            mjw.step1(m, d)

    def forward(self, ids: torch.Tensor) -> None:
        """Recompute the derived quantities of all robots; forces and warm start change in those of `ids` alone."""
        # NaN that a diverged robot has left would spread to its new state.
        self.warm_start[ids] = self.warm_start[ids].nan_to_num(0.0, 0.0, 0.0)
        warm_start, forces, torque = self.warm_start.clone(), self._force_sensors, self.torque
        for _ in range(1 if self._footing is None else 2):
            with self._running():
                mjw.forward(self._model, self._data)
            self._place_feet()
        warm_start[ids] = wp.to_torch(self._data.qacc)[ids]
        forces[ids], torque[ids] = self._sensors[ids], wp.to_torch(self._data.actuator_force)[ids]
        self.warm_start[:] = warm_start

    def _place_feet(self) -> None:
        if self._footing is not None:
            position, matrix, _ = self.link_poses()
            self._move_feet(self._footing.positions(position, matrix.flatten(2)))

    def _move_feet(self, positions: torch.Tensor) -> None:
        assert self._footing is not None
        self._geom_pos[:, self._footing.geoms] = positions.to(self._geom_pos)
        wp.to_torch(self._data.geom_xpos)[:, self._footing.geoms[-1]] = positions[:, -1].to(self._geom_pos)

    def restore_footing(self, footing: torch.Tensor) -> None:  # noqa: D102
        if self._footing is not None:
            self._move_feet(footing)
            with self._running():
                mjw.step1(self._model, self._data)

    def link_poses(self) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:  # noqa: D102
        return wp.to_torch(self._data.xpos), wp.to_torch(self._data.xmat), wp.to_torch(self._data.xipos)

    def faults(self) -> str:
        """Return in words what was dropped since the last call; empty if nothing was. This waits for the device."""
        overflow = wp.to_torch(self._data.overflow)
        dropped = overflow & ~int(_SOLVER)
        number, kinds = int((dropped != 0).sum()), int(dropped.amax())
        overflow.zero_()
        return f"contacts of {number} robots were dropped ({mjw.OverflowType(kinds)!r})" if number else ""
