"""Contact settings of the ground and of objects."""

import dataclasses
import math

import mujoco

from hugwbc.errors import ConfigError, UnknownNameError

_USUAL_TIME_CONSTANT = 0.02  # [s], MuJoCo's default
GROUNDS = ("firm", "soft")
CONES = {"pyramidal": mujoco.mjtCone.mjCONE_PYRAMIDAL, "elliptic": mujoco.mjtCone.mjCONE_ELLIPTIC}


@dataclasses.dataclass(frozen=True)
class Ground:
    """How firmly the robot stands: MuJoCo's settings of contacts, and of the solver that computes their forces.

    Attributes:
        time_constant: of the spring-damper that pushes a sole out of the ground (`solref`) [s]; MuJoCo raises it to two
            time steps if it is shorter.
        cone: friction cone, "pyramidal" or "elliptic".
        impratio: ratio of frictional to normal impedance; above 1 a standing foot creeps less.
        iterations: largest number of iterations of the solver.
    """

    time_constant: float = 0.005
    cone: str = "pyramidal"
    impratio: float = 1.0
    iterations: int = 20

    def __post_init__(self) -> None:
        if not 0.0 < self.time_constant < math.inf:
            raise ConfigError(f"time constant of the ground is {self.time_constant} s; give a finite time above 0 s")
        if self.cone not in CONES:
            raise UnknownNameError("friction cone", self.cone, tuple(CONES))
        if not 0.0 < self.impratio < math.inf:
            raise ConfigError(f"impratio of the ground is {self.impratio}; give a finite number above 0")
        if self.iterations < 1:
            raise ConfigError(f"the ground's solver has {self.iterations} iterations; give at least 1")

    @classmethod
    def named(cls, name: str) -> "Ground":
        """Return the firm ground of docs/arena.md, or the soft one of MuJoCo's default contacts."""
        if name not in GROUNDS:
            raise UnknownNameError("ground", name, GROUNDS)
        return cls() if name == "firm" else cls(time_constant=0.02)

    def apply_to(self, model: mujoco.MjModel) -> None:
        """Set the contacts and the solver of a newly compiled model."""
        usual = model.geom_solref[:, 0] == _USUAL_TIME_CONSTANT  # a file of the user's may ask for another
        model.geom_solref[usual, 0] = self.time_constant
        model.opt.cone = CONES[self.cone]
        model.opt.impratio = self.impratio
        model.opt.iterations = self.iterations
