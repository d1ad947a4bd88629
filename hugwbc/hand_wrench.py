"""What acts on the hands from outside, with the same signs from a hand target to the torques of the arms."""

import dataclasses
import math
import reprlib

import numpy as np

from hugwbc.errors import TargetError
from hugwbc.numeric import Shape, floats, keep_floats, number
from hugwbc.state import GRAVITY

STRONGEST = 200.0  # [N], the largest force to ask of a hand: the arms of an H1 give less in most postures
HEAVIEST = 20.0  # [kg], the largest payload of a hand, likewise
STIFFNESS = (50.0, 5000.0)  # [N/m], range of a hand's stiffness: from a light spring to more than the servo can give
BREAKING_FORCE = 150.0  # [N], at which the grip of an idealised gripper breaks, if nothing else is asked
FORCE_RATE = 100.0  # [N/s], at which a force comes and goes
PAYLOAD_RATE = 10.0  # [kg/s], likewise for a payload
STIFFNESS_RATE = 3000.0  # [N/m/s], at which one stiffness becomes another
_cut = reprlib.repr  # of a wrong value in a message: not all of it, and quick


@dataclasses.dataclass(frozen=True, eq=False)
class HandWrench:
    """Forces that the hands should meet, what they carry, and how they give way.

    Forces act *on the hands*, as those that are measured (`RobotState.hand_force`): a hand that presses down on a table
    with 15 N has (0, 0, 15). Their axes are those of the frame of the targets (`HandTargets`) or, for the arms
    (`UpperBody`), of the world.

    Attributes:
        force: on the left and the right hand [N], shape (2, 3). A hand gives way along its force and holds its
            position across it; 0 for a hand that only goes to its target. Two opposite forces squeeze an object: the
            hands then give way against each other, and hold their middle.
        payload: mass in the left and the right hand [kg], shape (2,); None if it is not known.
        stiffness: of both hands, as springs between them and their targets [N/m]; None for the servo's own.
    """

    force: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros((2, 3)))
    payload: np.ndarray | None = None
    stiffness: float | None = None

    def __post_init__(self) -> None:
        keep_floats(self, _SHAPES, ("payload", "stiffness"))

    @classmethod
    def of(
        cls, left: object = None, right: object = None, payload: object = None, stiffness: object = None
    ) -> "HandWrench":
        """Return a wrench from the force on each hand [N], shape (3,); raise a `TargetError` outside the ranges."""
        if left is right is payload is stiffness is None:
            return FREE
        forces = [
            np.zeros(3) if value is None else _force(f"{side} hand force", value)
            for side, value in (("left", left), ("right", right))
        ]
        masses = None if payload is None else floats(payload, (2,))
        if payload is not None and (masses is None or not np.all((masses >= 0.0) & (masses <= HEAVIEST))):
            raise TargetError(
                f"payload is {_cut(payload)}; give the masses in the left and the right hand in kg, such as (3, 0), "
                f"each from 0 to {HEAVIEST:g} kg"
            )
        spring = None if stiffness is None else number(stiffness)
        if stiffness is not None and (spring is None or not STIFFNESS[0] <= spring <= STIFFNESS[1]):
            raise TargetError(
                f"stiffness is {_cut(stiffness)}; give a number in newtons per metre from {STIFFNESS[0]:g} to "
                f"{STIFFNESS[1]:g}, or None for the servo's own"
            )
        return cls(np.array(forces), None if masses is None else masses.copy(), spring)

    @property
    def is_finite(self) -> bool:
        """Whether all numbers are finite and can be squared, and the stiffness is above 0."""
        together = np.append(self.force, () if self.payload is None else self.payload)
        return math.isfinite(together.dot(together)) and (self.stiffness is None or 0.0 < self.stiffness < math.inf)

    @property
    def total(self) -> np.ndarray:
        """All forces on the hands, with the weight of what they carry [N], shape (2, 3); of a wrench in the world."""
        if self.payload is None:
            return self.force
        force = self.force.copy()
        force[:, 2] -= GRAVITY * self.payload
        return force

    def limited(self) -> "HandWrench":
        """Return this wrench if it is within all ranges, else the nearest one that is; a force keeps its direction."""
        lengths = [math.hypot(*force) for force in self.force.tolist()]
        masses = [] if self.payload is None else self.payload.tolist()
        fits = self.stiffness is None or STIFFNESS[0] <= self.stiffness <= STIFFNESS[1]
        # Forces that were turned are rounded.
        if fits and max(lengths) <= STRONGEST * (1.0 + 1e-9) and all(0.0 <= mass <= HEAVIEST for mass in masses):
            return self
        share = STRONGEST / np.maximum(lengths, STRONGEST)
        payload = None if self.payload is None else np.minimum(np.maximum(self.payload, 0.0), HEAVIEST)
        stiffness = None if self.stiffness is None else min(max(self.stiffness, STIFFNESS[0]), STIFFNESS[1])
        return HandWrench(share[:, None] * self.force, payload, stiffness)

    def towards(self, goal: "HandWrench", dt: float) -> "HandWrench":
        """Return the wrench `dt` [s] later on the way to a goal within all ranges (`limited`), without jumps.

        A payload that is not known stays unknown. One that was known and no longer is falls to zero first, so that the
        torque that carried it does not stop at once. From the servo's own stiffness to another and back, the drives are
        blended instead (`hugwbc.runtime.arms.Handover`).
        """
        if self is goal is FREE:
            return FREE
        gap = goal.force - self.force
        length = np.sqrt((gap * gap).sum(axis=1, keepdims=True))
        force = self.force + gap * np.minimum(1.0, FORCE_RATE * dt / np.maximum(length, 1e-12))
        carried = np.zeros(2) if self.payload is None else self.payload
        told = np.zeros(2) if goal.payload is None else goal.payload
        carried = carried + np.minimum(np.maximum(told - carried, -PAYLOAD_RATE * dt), PAYLOAD_RATE * dt)
        payload = None if goal.payload is None and not carried.any() else carried
        stiffness = goal.stiffness
        if stiffness is not None and self.stiffness is not None:
            step = STIFFNESS_RATE * dt
            stiffness = min(max(stiffness, self.stiffness - step), self.stiffness + step)
        return FREE if payload is stiffness is None and not force.any() else HandWrench(force, payload, stiffness)


_SHAPES: dict[str, Shape] = {"force": (2, 3), "payload": (2,), "stiffness": ()}
FREE = HandWrench()
"""Nothing is known to act on the hands."""
FREE.force.setflags(write=False)


def _force(name: str, value: object) -> np.ndarray:
    vector = floats(value, (3,))
    if vector is None or not float(np.linalg.norm(vector)) <= STRONGEST:  # a NaN fails the comparison
        raise TargetError(
            f"{name} is {_cut(value)}; give three finite numbers x, y, z in newtons, such as (15, 0, 0), together at "
            f"most {STRONGEST:g} N"
        )
    return vector
