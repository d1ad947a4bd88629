"""Under which conditions a controller is evaluated: physics time step, ground, external control of the arms."""

import dataclasses
import functools
import math
import pathlib
from typing import TYPE_CHECKING

import numpy as np

from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.estimation import StateEstimator
from hugwbc.sim import Simulation, noisy_simulation, rough_terrain
from hugwbc.sim.scene import SIMULATION_TIMESTEP

if TYPE_CHECKING:
    from hugwbc.evaluation.intervention import ArmIntervention

INTERVENTIONS = ("none", "noise", "motion")
NOISE_INTERVAL = 90  # control steps between two targets of the noise, the paper's
GENERATED_MOTIONS_SEED = 1  # other motions than the training's
_START_RADIUS = 0.6  # [m] of plane ground around the start
_STEEPEST = 0.5  # [rad]
_TOP_SPEED = 2.5  # [m/s], with which the ground must be large enough


@dataclasses.dataclass(frozen=True)
class Conditions:
    """Settings.

    Attributes:
        timestep: of the physics [s].
        terrain_roughness: half-width of the uniformly random ground height [m]; 0 for a plane.
        slope: angle at which the ground rises along x, the robot's first heading [rad].
        noise: whether sensors have a real robot's noise and latency, and the state is estimated from them.
        intervention: one of `INTERVENTIONS`: what moves the arms during the whole episode.
        motions: folder of motion files for the motion intervention; None for generated motions.
    """

    timestep: float = SIMULATION_TIMESTEP
    terrain_roughness: float = 0.0
    slope: float = 0.0
    noise: bool = False
    intervention: str = "none"
    motions: str | None = None

    def __post_init__(self) -> None:
        if self.intervention not in INTERVENTIONS:
            raise UnknownNameError("intervention", self.intervention, INTERVENTIONS)
        if not (0.0 <= self.terrain_roughness < 0.5 and math.isfinite(self.terrain_roughness)):
            raise ConfigError(f"terrain roughness is {self.terrain_roughness}; give a height from 0 to 0.5 m")
        if not abs(self.slope) <= _STEEPEST:
            raise ConfigError(f"slope is {self.slope} rad; give an angle from {-_STEEPEST} to {_STEEPEST} rad")

    def simulation(self, duration: float, seed: tuple[int, ...]) -> Simulation:
        """The robot on the ground of one episode.

        Args:
            duration: of the episode [s]; the ground is large enough for it.
            seed: of the ground and of the sensors' noise.
        """
        make = Simulation
        if self.noise:
            make = functools.partial(noisy_simulation, seed=int(np.random.SeedSequence(seed).generate_state(1)[0]))
        if self.terrain_roughness == 0.0 and self.slope == 0.0:
            return make(timestep=self.timestep)
        size = 2.0 * (_TOP_SPEED * duration + _START_RADIUS + 1.0)
        rng = np.random.default_rng(seed)
        terrain = rough_terrain(self.terrain_roughness, rng, size=size, start_radius=_START_RADIUS, slope=self.slope)
        return make(timestep=self.timestep, terrain=terrain)

    def estimator(self) -> StateEstimator | None:
        """What gives the controller its state; None where it reads the sensors itself."""
        return StateEstimator() if self.noise else None

    def arms(self, seed: tuple[int, ...]) -> "ArmIntervention | None":
        """What moves the arms in one episode; None leaves them to the controller.

        Raises:
            MotionFileError: if the motion files cannot be used.
        """
        if self.intervention == "none":
            return None
        # Loads torch, which only some evaluations need.
        import torch

        from hugwbc.evaluation.intervention import ArmIntervention
        from hugwbc.learned.arm_targets import MotionTargets, NoiseTargets
        from hugwbc.motion import generate_motions, load_motions

        generator = torch.Generator().manual_seed(int(np.random.SeedSequence(seed).generate_state(1)[0]))
        if self.intervention == "noise":
            return ArmIntervention(NoiseTargets(1, NOISE_INTERVAL, generator))
        motions = (
            generate_motions(GENERATED_MOTIONS_SEED)
            if self.motions is None
            else load_motions(pathlib.Path(self.motions))
        )
        return ArmIntervention(MotionTargets(1, motions, generator))
