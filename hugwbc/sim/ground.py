"""Contact settings of the ground and of objects."""

from typing import Literal

import mujoco

from hugwbc.errors import UnknownNameError
from hugwbc.settings import Count, Positive, settings

_USUAL_TIME_CONSTANT = 0.02  # [s], MuJoCo's default
GROUNDS = ("firm", "soft")
CONES = {"pyramidal": mujoco.mjtCone.mjCONE_PYRAMIDAL, "elliptic": mujoco.mjtCone.mjCONE_ELLIPTIC}


@settings
class Ground:
    """How firmly the robot stands: MuJoCo's settings of contacts, and of the solver that computes their forces.

    Attributes:
        time_constant: of the spring-damper that pushes a sole out of the ground (`solref`) [s]; MuJoCo raises it to two
            time steps if it is shorter.
        cone: friction cone, "pyramidal" or "elliptic".
        impratio: ratio of frictional to normal impedance; above 1 a standing foot creeps less.
        iterations: largest number of iterations of the solver.
    """

    time_constant: Positive = 0.005
    cone: Literal["pyramidal", "elliptic"] = "pyramidal"
    impratio: Positive = 1.0
    iterations: Count = 20

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
