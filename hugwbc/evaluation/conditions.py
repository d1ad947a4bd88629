"""Conditions of an evaluation: physics, ground, robot, sensors, external control of the arms."""

import dataclasses
import pathlib
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field

from hugwbc.commands import Command
from hugwbc.controller import UpperBody
from hugwbc.errors import ConfigError
from hugwbc.robot import Robot, load_robot
from hugwbc.runtime.estimation import StateEstimator
from hugwbc.runtime.trace import Trace
from hugwbc.scripts.motion import MOTION_FPS
from hugwbc.settings import one_of, settings
from hugwbc.sim import Arena, Engine, Scene, Simulation, Variation, rough_terrain
from hugwbc.sim.arena import ENGINES
from hugwbc.sim.faults import Fault
from hugwbc.sim.robot_model import SIMULATION_TIMESTEP, check_timestep
from hugwbc.state import RobotState
from hugwbc.targets import HandTargets
from hugwbc.upper_ik import UpperBodySource

if TYPE_CHECKING:
    from hugwbc.learned.env.arm_intervention import ArmTargets

INTERVENTIONS = ("none", "noise", "motion")
GENERATED_MOTIONS_SEED = 1  # not the seed of the training's motions
_PERIOD = 1.0 / MOTION_FPS  # [s] between two postures of moved arms
_START_RADIUS = 0.6  # [m], radius of plane ground around the start
_TOP_SPEED = 2.5  # [m/s], fastest walk that the ground must be large enough for
_LONGEST_ON_GROUND = 200.0  # [s]; the height field for it spans a kilometre and has 25 million heights


@settings
class Conditions:
    """Physics, ground, robot, sensors and external control of the arms in an episode."""

    robot: str = Arena.robot  # Robot: h1, h1-2023 (the maker's earlier description), g1, or the path of a table
    drives: str = Arena.drives  # Drives of the joints: real (torque-speed limit, friction and delay), or ideal
    # Sensors: robot (those of an H1, with noise, biases and latency, the state estimated from them), or exact (the true
    # state)
    sensing: str = Arena.sensing
    ground: str = Arena.ground  # Ground: firm, or soft
    # physics engine: mujoco, or physx (PhysX 5, on level ground only)
    engine: Annotated[str, one_of("engine", lambda: ENGINES)] = Simulation.engine
    timestep: float = SIMULATION_TIMESTEP  # time step of the physics [s]
    # half-width of the uniformly random ground height [m]; 0 for a plane
    terrain_roughness: Annotated[float, Field(ge=0, lt=0.5)] = 0.0
    # angle at which the ground rises along x, the robot's initial heading [rad]
    slope: Annotated[float, Field(ge=-0.5, le=0.5)] = 0.0
    # robot that the state estimator, the hand IK and a model-based controller are told; by default the simulated one.
    # Another one shows what wrong masses do
    told: str | None = None
    # what moves the arms during the whole episode: none, noise (a uniform target every 1.8 s) or motion (motion files)
    intervention: Annotated[str, one_of("intervention", lambda: INTERVENTIONS)] = "none"
    # folder of motion files (.npz, .csv) for the motion intervention; None for generated motions
    motions: str | None = None
    payload: float = 0.0  # mass added to the torso [kg]
    # friction coefficient between robot and ground; None for that of the robot description
    friction: float | None = None
    # age of the sensor readings [s]; None for that of the sensors
    latency: Annotated[float, Field(ge=0, le=0.5)] | None = None
    gain: float = 1.0  # factor on the joints' stiffness and damping
    strength: float = 1.0  # factor on the motors' torque
    hand_payload: float = 0.0  # mass in each hand [kg]; no controller is told
    # faults of sensors and motors, each as KIND@START:DURATION in seconds, such as imu-gone@4:0.2 (`hugwbc.sim.faults`)
    faults: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        _ = self.chosen
        check_timestep(self.timestep)
        ENGINES[self.engine].check_available()
        if self.engine != Simulation.engine and not self.is_level:
            raise ConfigError(f"engine {self.engine} has level ground only; leave out the terrain and the slope")
        if self.engine != Simulation.engine and self.chosen.ground != "firm":
            raise ConfigError(f"engine {self.engine} has firm ground only; use --ground firm")
        if self.engine != Simulation.engine and self.hand_payload:
            raise ConfigError(f"engine {self.engine} has no payload in the hands; leave out the hand payload")
        self.variation()
        _ = self.told_arena, self.declared_faults

    @property
    def chosen(self) -> Arena:
        """Robot, drives, sensors and ground."""
        return Arena(self.robot, self.drives, self.sensing, self.ground)

    @property
    def told_arena(self) -> Arena:
        """The arena as the controller and the estimator are told it: perhaps with another robot."""
        arena = self.chosen
        return arena if self.told is None else dataclasses.replace(arena, robot=self.told)

    @property
    def declared_faults(self) -> tuple[Fault, ...]:
        """The faults of sensors and motors."""
        return tuple(map(Fault.parse, self.faults))

    @property
    def is_level(self) -> bool:
        """Whether the ground is a level plane, which is infinite."""
        return self.terrain_roughness == 0.0 and self.slope == 0.0

    def check_duration(self, duration: float) -> None:
        """Check that an episode of this duration [s] has all faults, and that its ground fits into memory."""
        for text, fault in zip(self.faults, self.declared_faults, strict=True):
            if fault.start >= duration:
                raise ConfigError(
                    f"fault {text} starts after the episode, which takes {duration:g} s; give it an earlier start, or "
                    "the episode a longer duration"
                )
        if not self.is_level and duration > _LONGEST_ON_GROUND:
            raise ConfigError(
                f"duration is {duration:g} s on rough or sloping ground; give up to {_LONGEST_ON_GROUND:g} s, in which "
                "a robot can go half a kilometre"
            )

    def variation(self) -> Variation:
        """Return how the robot differs from its description."""
        return Variation(self.payload, self.friction, self.gain, self.strength, self.hand_payload)

    def of_a_drawn_robot(self, rng: np.random.Generator) -> "Conditions":
        """Return these conditions with friction, payload and gain drawn from the training's default ranges.

        Those are an H1's; another robot's payload is in proportion to its mass.
        """
        from hugwbc.learned.config import RandomizationConfig

        ranges = RandomizationConfig()
        friction, payload, gain = (rng.uniform(*r) for r in (ranges.friction, ranges.torso_mass, ranges.gains))
        payload *= load_robot(self.robot).mass / load_robot(Arena.robot).mass
        return dataclasses.replace(self, friction=float(friction), payload=float(payload), gain=float(gain))

    def simulation(self, duration: float, seed: int | tuple[int, ...], scene: Scene | None = None) -> Engine:
        """Return the simulation of one episode; its duration [s] determines the size of the ground.

        The seed is that of the ground, of the sensor noise and of what varies in the scene: a number as
        `Arena.simulation` takes it, or the seed of an experiment and the number of the episode.
        """
        terrain = None
        if not self.is_level:
            size = 2.0 * (_TOP_SPEED * duration + _START_RADIUS + 1.0)
            options = {"size": size, "start_radius": _START_RADIUS, "slope": self.slope}
            terrain = rough_terrain(self.terrain_roughness, np.random.default_rng(seed), **options)
        return self.chosen.simulation_in(
            ENGINES[self.engine],
            terrain=terrain,
            timestep=self.timestep,
            variation=self.variation(),
            latency=self.latency,
            faults=self.declared_faults,
            seed=seed if isinstance(seed, int) else int(np.random.SeedSequence(seed).generate_state(1)[0]),
            scene=scene,
        )

    def estimator(self) -> StateEstimator | None:
        """Return the estimator that gives the controller its state; None where it gets the true state."""
        return StateEstimator(robot=self.told_arena.known_robot) if self.chosen.estimates else None

    def upper_body(self) -> UpperBodySource:
        """Return what turns hand targets into arm targets; it is told the robot as the controller is."""
        return UpperBodySource(robot=self.told_arena.known_robot)

    def arms(self, seed: tuple[int, ...]) -> "ArmIntervention | None":
        """Return what moves the arms in one episode, with targets of a seed; None leaves them to the controller."""
        if self.intervention == "none":
            return None
        # They load torch, which only some evaluations need.
        import torch

        from hugwbc.learned.env.arm_intervention import make_arm_targets

        generator = torch.Generator().manual_seed(int(np.random.SeedSequence(seed).generate_state(1)[0]))
        robot = load_robot(self.robot)
        targets = make_arm_targets(
            self.intervention,
            robot,
            1,
            motions=None if self.motions is None else pathlib.Path(self.motions),
            motions_seed=GENERATED_MOTIONS_SEED,
            generator=generator,
        )
        return ArmIntervention(targets, robot)


class ArmIntervention:
    """A source of arm targets for `ControlLoop` that moves both arms whatever the hand targets are.

    The postures come at 50 Hz. Between two postures the targets are interpolated linearly, with their velocity.
    """

    solution = None

    def __init__(self, source: "ArmTargets", robot: Robot) -> None:
        """Play a source of arm targets for one robot."""
        self._source, self._robot = source, robot
        self._nominal = robot.nominal[robot.arms]
        self.postures: list[np.ndarray] = []  # since `reset` at 50 Hz [rad], each (k,)
        self.reset()

    def reset(self) -> None:
        """Return to the nominal posture; the source continues with new targets."""
        import torch  # which only some evaluations need

        self._source.reset(torch.tensor([0]))
        self.postures = []
        self._begin = self._end = self._nominal
        self._elapsed = _PERIOD

    def update(
        self,
        state: RobotState,
        hands: HandTargets | None,
        command: Command,
        dt: float,
        commanded: np.ndarray | None = None,
        followed: Command | None = None,
    ) -> tuple[UpperBody, Command]:
        """Return the arm targets at the end of the next `dt` seconds, and the command; the others do not matter."""
        self._elapsed += dt
        while self._elapsed > _PERIOD + 1e-9:
            self._elapsed -= _PERIOD
            self._source.step()
            self._begin, self._end = self._end, self._source.targets()[0].double().numpy()
            self.postures.append(self._end)
        ratio = self._elapsed / _PERIOD
        speed = (self._end - self._begin) / _PERIOD
        return UpperBody.targets(self._begin + ratio * (self._end - self._begin), speed), command

    def error(self, trace: Trace, settle: float) -> float:
        """Return the mean distance of the arm joints to their targets after `settle` [s] of a run [rad].

        NaN if the run ended before.
        """
        steps = min(len(self.postures), len(trace.time) - 1)
        # A sample is taken before the target of its time acts, so the next sample shows the effect.
        kept = trace.time[1 : steps + 1] >= settle
        reached = trace.qpos[1 : steps + 1, 7:][:, self._robot.arms]
        difference = np.abs(reached - np.array(self.postures[:steps]).reshape(steps, -1))[kept]
        return float(difference.mean()) if difference.size else float("nan")
