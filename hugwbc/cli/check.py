"""`hugwbc check`: is this installation sound? Models, versions, controllers and environment, each tried for real."""

import dataclasses
import importlib.metadata
import platform
from collections.abc import Callable, Sequence

import numpy as np

from hugwbc.cli.output import parse, progress, say
from hugwbc.errors import HugwbcError

PACKAGES = ("mujoco", "pin", "placo", "proxsuite", "torch", "numpy", "safetensors", "meshcat", "tyro")
CHECK_FAILED = 1
SAMPLES = 20


class CheckError(Exception):
    """A check found something wrong; the message says what."""


@dataclasses.dataclass(frozen=True)
class CheckOptions:
    """Verify the models, versions, controllers and the training environment; exit code 1 if anything is wrong."""


def run(words: Sequence[str]) -> int:
    """Run all checks and print a line for each."""
    parse(CheckOptions, words, "check", CheckOptions.__doc__)
    lines, failed = [], 0
    with progress("check") as advance:
        for index, (name, check) in enumerate(CHECKS.items()):
            try:
                lines.append(f"ok    {name}: {check()}")
            except (CheckError, HugwbcError, ImportError) as error:
                failed += 1
                lines.append(f"FAIL  {name}: {error}")
            advance((index + 1) / len(CHECKS))
    say("\n".join(lines))
    say("all is well" if not failed else f"{failed} of {len(CHECKS)} checks failed")
    return CHECK_FAILED if failed else 0


def _versions() -> str:
    found = []
    for package in PACKAGES:
        try:
            found.append(f"{package} {importlib.metadata.version(package)}")
        except importlib.metadata.PackageNotFoundError:
            raise CheckError(f"{package} is not installed; run `pip install hugwbc` again") from None
    return f"Python {platform.python_version()}, {', '.join(found)}"


def _masses() -> str:
    from hugwbc.kinematics import pinocchio_model
    from hugwbc.sim import Simulation

    urdf = sum(inertia.mass for inertia in pinocchio_model().inertias)
    mjcf = float(Simulation().model.body_mass.sum())
    if abs(urdf - mjcf) > 1e-6:
        raise CheckError(f"h1.urdf weighs {urdf:.6f} kg, h1.xml {mjcf:.6f} kg; restore both from the repository")
    return f"h1.xml and h1.urdf weigh {mjcf:.2f} kg"


def _agreement() -> str:
    """MJCF against URDF on random states: mass matrix, height of the feet, hand positions."""
    import mujoco
    import pinocchio as pin

    from hugwbc.kinematics import Kinematics
    from hugwbc.robot import SIDES
    from hugwbc.sim import Simulation

    simulation, kinematics, rng = Simulation(), Kinematics(), np.random.default_rng(0)
    worst = 0.0
    for _ in range(SAMPLES):
        q = rng.uniform(simulation.robot.lower, simulation.robot.upper)
        state = simulation.reset(xy=(1.0, -2.0), yaw=float(rng.uniform(-3.0, 3.0)), q=q)
        kinematics.update(state)
        inertia = np.zeros((simulation.model.nv, simulation.model.nv))
        mujoco.mj_fullM(simulation.model, simulation.data, inertia)
        columns = 6 + np.arange(len(q))
        joints = pin.crba(kinematics.model, kinematics.data, kinematics.q)[
            np.ix_(kinematics.columns, kinematics.columns)
        ]
        hands = [kinematics.position(f"{s}_hand") - simulation.hand_position(s) for s in SIDES]
        worst = max(worst, np.abs(joints - inertia[np.ix_(columns, columns)]).max(), np.abs(hands).max())
    if worst > 1e-6:
        raise CheckError(f"h1.xml and h1.urdf differ by up to {worst:.2g} in mass matrix or hand position")
    return f"h1.xml and h1.urdf agree to {worst:.1e} on {SAMPLES} random states"


def _standing() -> str:
    from hugwbc.commands import Command
    from hugwbc.runtime import Constant, rollout
    from hugwbc.runtime.controllers import ControllerSpec
    from hugwbc.sim import Simulation

    trace = rollout(ControllerSpec("qp").build(), Constant(Command(h=-0.1)), Simulation(), duration=2.0)
    if trace.fell or trace.safety.failures:
        raise CheckError(f"qp fell after {trace.survived_s:.1f} s; {trace.safety.messages}")
    return f"qp stands and squats; pelvis at h = {trace.measured[-1, 3]:.3f} m of -0.1 m"


def _policies() -> str:
    from hugwbc.learned.policy.policy import load_policy, shipped_policies

    names = shipped_policies()
    if not names:
        raise CheckError("no policy is shipped in models/h1/policies; train one with `hugwbc train`")
    for name in names:
        load_policy(name)
    return f"{', '.join(names)} can be read"


def _environment() -> str:
    """A short rollout of the training environment: finite, and equal for equal seeds."""
    import torch

    from hugwbc.learned.config import EnvConfig
    from hugwbc.learned.env.humanoid_env import HumanoidEnv
    from hugwbc.learned.policy.observations import JOINTS

    count, steps = 8, 20
    histories = []
    for _ in range(2):
        env = HumanoidEnv(EnvConfig(count=count), seed=7, threads=1)
        generator = torch.Generator().manual_seed(7)
        for _ in range(steps):
            result = env.step(0.1 * torch.randn(count, JOINTS, generator=generator))
            if not bool(torch.isfinite(result.reward).all()):
                raise CheckError("a reward of the training environment is not finite")
        histories.append(env.observe().critic)
    if not bool(torch.isfinite(histories[0]).all()):
        raise CheckError("an observation of the training environment is not finite")
    if not torch.equal(*histories):
        raise CheckError("two runs of the training environment with the same seed differ")
    return f"{count} robots, {steps} steps: finite, and the same twice with one seed"


CHECKS: dict[str, Callable[[], str]] = {
    "versions": _versions,
    "masses": _masses,
    "models": _agreement,
    "controller qp": _standing,
    "policies": _policies,
    "training environment": _environment,
}
