"""Check an installation by trying its parts: versions, robot models, controllers, training environment."""

import importlib.metadata
import importlib.util
import platform
from collections.abc import Callable

import numpy as np

from hugwbc.errors import HugwbcError

PACKAGES = ("mujoco", "pin", "placo", "proxsuite", "numpy", "meshcat", "tyro")
LEARNED = ("torch", "safetensors")  # of the extra [learned]
WITHOUT_TORCH = "left out: torch is not installed; `pip install 'hugwbc[learned]'` brings it"
SAMPLES = 20  # random states on which the models are compared


class CheckError(Exception):
    """A check found something wrong; the message says what."""


def run_checks(on_progress: Callable[[float], object] = lambda fraction: None) -> list[tuple[str, bool, str]]:
    """Run every check, whether others fail or not; return what was checked, whether it is right, and what was found."""
    outcomes = []
    for index, (name, check) in enumerate(CHECKS.items()):
        try:
            outcomes.append((name, True, check()))
        except (CheckError, HugwbcError, ImportError) as error:
            outcomes.append((name, False, str(error)))
        on_progress((index + 1) / len(CHECKS))
    return outcomes


def check_versions() -> str:
    """Check that every package that hugwbc needs is installed."""
    found = []
    for package in PACKAGES:
        try:
            found.append(f"{package} {importlib.metadata.version(package)}")
        except importlib.metadata.PackageNotFoundError:
            raise CheckError(f"{package} is not installed; run `pip install hugwbc` again") from None
    found += [f"{name} {importlib.metadata.version(name)}" for name in LEARNED if _is_installed(name)]
    return f"Python {platform.python_version()}, {', '.join(found)}"


def check_arena() -> str:
    """Check that a robot can be put into the arena, and name its version, on which results depend."""
    from hugwbc.sim.arena import ENGINES, Arena

    arena = Arena()
    arena.simulation()
    engines = [name for name, kind in ENGINES.items() if kind.is_available()]
    parts = f"{arena.robot}, {arena.drives} drives, sensors {arena.sensing}, {arena.ground} ground"
    return f"{parts}, version {arena.version}; engines {', '.join(engines)}"


def check_agreement() -> str:
    """Check that the MuJoCo and the URDF model agree on masses, and on the hands' positions in random states."""
    import mujoco
    import pinocchio as pin

    from hugwbc.kinematics import Kinematics
    from hugwbc.robot import SIDES
    from hugwbc.sim import Simulation

    simulation, rng = Simulation(), np.random.default_rng(0)
    kinematics = Kinematics(simulation.robot)
    mass = float(simulation.model.body_mass.sum())
    worst = abs(sum(inertia.mass for inertia in kinematics.model.inertias) - mass)
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
        raise CheckError(f"h1.xml and h1.urdf differ by up to {worst:.2g} in mass, mass matrix or hand position")
    return f"h1.xml and h1.urdf weigh {mass:.2f} kg, and agree to {worst:.1e} on {SAMPLES} random states"


def check_standing() -> str:
    """Check that `qp` stands and squats for two seconds."""
    from hugwbc.commands import Command
    from hugwbc.runtime import rollout
    from hugwbc.runtime.controllers import ControllerSpec
    from hugwbc.sim import Simulation

    trace = rollout(ControllerSpec("qp").build(), Command(h=-0.1), Simulation(), duration=2.0)
    if trace.fell or trace.safety.failures:
        raise CheckError(f"the controller qp fell after {trace.survived_s:.1f} s; {trace.safety.messages}")
    return f"the controller qp stands and squats; pelvis at h = {trace.measured[-1, 3]:.3f} m of -0.1 m"


def _is_installed(package: str) -> bool:
    try:
        return importlib.util.find_spec(package) is not None
    except (ImportError, ValueError):  # it is kept out on purpose
        return False


def check_policies() -> str:
    """Check that every shipped policy can be read, if policies can be run at all."""
    if not all(map(_is_installed, LEARNED)):
        return WITHOUT_TORCH
    from hugwbc.learned.policy import load_policy, shipped_policies

    names = shipped_policies()
    if not names:
        raise CheckError("no policy is shipped in models/h1/policies; train one with `hugwbc train`")
    for name in names:
        load_policy(name)
    return f"{', '.join(names)} can be read"


def check_environment() -> str:
    """Check that the training environment gives finite numbers, the same ones for the same seed."""
    if not all(map(_is_installed, LEARNED)):
        return WITHOUT_TORCH
    import torch

    from hugwbc.learned.config import EnvConfig
    from hugwbc.learned.env.humanoid_env import HumanoidEnv

    count, steps = 8, 20
    histories = []
    for _ in range(2):
        env = HumanoidEnv(EnvConfig(count=count), seed=7, threads=1)
        generator = torch.Generator().manual_seed(7)
        for _ in range(steps):
            result = env.step(0.1 * torch.randn(env.actions[0].shape, generator=generator))
            if not bool(torch.isfinite(result.reward).all()):
                raise CheckError("a reward of the training environment is not finite")
        histories.append(env.observe().critic)
    if not bool(torch.isfinite(histories[0]).all()):
        raise CheckError("an observation of the training environment is not finite")
    if not torch.equal(*histories):
        raise CheckError("two runs of the training environment with the same seed differ")
    return f"{count} robots, {steps} steps: finite, and the same twice with one seed"


CHECKS: dict[str, Callable[[], str]] = {
    "versions": check_versions,
    "arenas": check_arena,
    "models": check_agreement,
    "controller qp": check_standing,
    "policies": check_policies,
    "training environment": check_environment,
}
