"""The engine of GPUs, on Warp's CPU device, against MuJoCo: the extra [gpu]; it compiles for minutes the first time."""

import dataclasses
import pathlib

import numpy as np
import pytest
import torch

from hugwbc.learned.config import CommandConfig, EnvConfig, LoadConfig, PPOConfig, RandomizationConfig, TrainConfig
from hugwbc.learned.config.environment import TerrainConfig
from hugwbc.learned.env import HumanoidEnv
from hugwbc.learned.policy import load_policy
from hugwbc.learned.rl.trainer import CHECKPOINT_NAME, Trainer
from hugwbc.robot import load_robot
from hugwbc.sim.batch import RobotBatch

pytestmark = pytest.mark.slow
pytest.importorskip("mujoco_warp", reason="needs the extra [gpu]")
COUNT, STEPS = 16, 100
LOW = 0.7  # [m], of the pelvis of a robot that falls
MODEL = (
    "geom_friction", "body_mass", "body_ipos", "body_inertia", "actuator_gainprm", "actuator_biasprm",
    "dof_frictionloss", "dof_damping",
)  # fmt: skip
EVERYTHING = EnvConfig(
    count=COUNT,
    command=CommandConfig(hopping_fraction=0.2, walking_fraction=0.5, standing_fraction=0.1, resample_steps=40),
    loads=LoadConfig(payload=3.0, hand_force=30.0, trunk_force=60.0, hand_interval=1.0, trunk_interval=1.0),
    randomization=RandomizationConfig(push_interval=50),
    flip_probability=0.05,
    episode_steps=60,
)
ROUGH = TerrainConfig(roughness=0.02, levels=3, start_level=2)


def warp_batch(count: int = 4, **settings: object) -> RobotBatch:
    from hugwbc.sim.warp_batch import WarpBatch

    return WarpBatch(count, device="cpu", **settings, robot=load_robot())


def copy_state(source: RobotBatch, target: RobotBatch) -> None:
    """Give robots of another engine the state and the model of these, before a control step."""
    weighed = torch.equal(target.expand("body_mass"), source.expand("body_mass").float())
    for name in MODEL:
        field = target.expand(name)
        field[:] = source.expand(name).reshape(field.shape)
    if not weighed:
        target.set_const()
    for name in ("qpos", "qvel", "ctrl", "forces"):
        getattr(target, name)[:] = getattr(source, name)
    target.forward(torch.arange(target.count))
    target.warm_start[:] = source.warm_start


def differences(one: RobotBatch, other: RobotBatch) -> dict[str, torch.Tensor]:
    """Largest difference of each quantity, by robot."""
    found = {name: (getattr(one, name), getattr(other, name)) for name in ("qpos", "qvel", "torque")}
    found |= {name: (getattr(one, name)(), getattr(other, name)()) for name in ("sole_position", "sole_velocity")}
    found |= {name: (getattr(one, name)(), getattr(other, name)()) for name in ("foot_force", "link_force")}
    return {name: (a - b).abs().flatten(1).amax(1) for name, (a, b) in found.items()}


# Of a control step, in SI units: rounding of single precision, through impacts of several kN.
BOUNDS = {
    "qpos": 2e-5, "qvel": 2e-3, "torque": 0.02, "sole_position": 2e-5, "sole_velocity": 2e-3, "foot_force": 2.0,
    "link_force": 2.0,
}  # fmt: skip


@pytest.mark.parametrize("terrain", [TerrainConfig(), ROUGH], ids=["plane", "rough"])
def test_a_control_step_is_mujoco_s_with_everything_on(terrain: TerrainConfig, monkeypatch: pytest.MonkeyPatch) -> None:
    """The shipped policy walks in MuJoCo; each control step is repeated from the same state."""
    env = HumanoidEnv(dataclasses.replace(EVERYTHING, terrain=terrain), seed=5, threads=1)
    ours, actor = env.simulation, load_policy("h1").actor
    other = warp_batch(COUNT, terrain=ours.terrain)
    rows: list[dict[str, torch.Tensor]] = []
    lying: list[torch.Tensor] = []
    original = ours.step

    def step(substeps: int, targets: torch.Tensor | None = None) -> torch.Tensor:
        copy_state(ours, other)
        diverged = original(substeps, targets)
        assert torch.equal(other.step(substeps, targets), diverged)
        rows.append(differences(ours, other))
        # Boxes of a fallen robot meet a height field at other points; feet, which have their own plane, do not.
        lying.append((ours.qpos[:, 2] < LOW) & (ours.terrain is not None))
        return diverged

    monkeypatch.setattr(ours, "step", step)
    for _ in range(STEPS):
        seen = env.observe()
        with torch.no_grad():
            action, _ = actor(seen.history, seen.command)
        env.step(action)
    standing = ~torch.stack(lying)
    found = {name: torch.stack([row[name] for row in rows])[standing] for name in BOUNDS}
    outside = torch.stack([values > BOUNDS[name] for name, values in found.items()]).any(0)
    for name, values in found.items():
        median, most, largest = (float(values.quantile(share)) for share in (0.5, 0.998, 1.0))
        print(f"{name:14} median {median:.1e}, 99.8 % {most:.1e}, largest {largest:.1e}")
    print(f"{int(outside.sum())} of {outside.numel()} robot-steps outside; {env.statistics.pop()['falls']:.0f} falls")
    assert standing.float().mean() > 0.8 and not other.faults()
    # A foot that just grazes the ground may touch it in one engine and not in the other.
    assert outside.float().mean() < 0.002


def moved(batch: RobotBatch) -> RobotBatch:
    """Robots in different postures that fall onto the ground."""
    rng = np.random.default_rng(0)
    batch.set_const()  # its rounding is not that of the compiler
    batch.qpos[:, 2] += 0.01
    batch.qvel[:] = batch.tensor(rng.uniform(-0.5, 0.5, (batch.count, 25)))
    batch.forward(torch.arange(batch.count))
    for _ in range(5):
        batch.step(4)
    return batch


@pytest.mark.parametrize("rough", [False, True])
def test_a_reset_and_a_nan_change_no_other_robot_by_a_bit(rough: bool) -> None:
    from hugwbc.sim.terrain import level_terrain

    terrain = level_terrain(2, 0.02, np.random.default_rng(0)).field if rough else None
    calm, busy = moved(warp_batch(6, terrain=terrain)), moved(warp_batch(6, terrain=terrain))
    others, some = [0, 2, 3], torch.tensor([1, 4])
    busy.qvel[5, 10], diverged = torch.nan, torch.zeros(6, dtype=torch.bool)
    for step in range(4):
        if step == 1:
            assert diverged[5] and not diverged[:5].any()
            some = torch.tensor([1, 4, 5])
        for ids in (some, some[:1]):
            busy.qpos[ids] = busy.tensor(busy.nominal_qpos)
            busy.qvel[ids] = 0.1
            busy.expand("body_mass")[ids, 5] *= 1.5
            busy.set_const(ids)
            busy.forward(ids)
        calm.step(4)
        diverged = busy.step(4)
        for name, values in differences(calm, busy).items():
            assert not values[others].any(), name
    assert not diverged.any() and busy.qpos.isfinite().all(), "a new episode has nothing of the NaN"


def test_dropped_contacts_are_reported() -> None:
    batch = moved(warp_batch(4, contacts=2))
    assert "contacts of 4 robots were dropped" in batch.faults() and not batch.faults()


def test_checkpoints_go_from_one_engine_to_the_other(tmp_path: pathlib.Path) -> None:
    env = dataclasses.replace(EVERYTHING, terrain=ROUGH)
    config = TrainConfig(
        env=env, ppo=PPOConfig(horizon=4, minibatches=1, epochs=1), out=tmp_path, threads=1, evaluation_steps=0
    )
    states = []
    for run, device in enumerate(("warp", "cpu", "warp")):
        limits = {"steps": 4.0 * COUNT * (run + 1), "resume": run > 0}
        trainer = Trainer(dataclasses.replace(config, device=device, **limits))
        if states:
            torch.testing.assert_close(trainer.env.simulation.qpos.float(), states[-1], atol=1e-6, rtol=0.0)
        trainer.run(lambda row, gates: None)
        assert trainer.iteration == run + 1 and (tmp_path / CHECKPOINT_NAME).exists()
        states.append(trainer.env.simulation.qpos.float().clone())
        assert trainer.env.history.isfinite().all()
