"""Per-robot model parameters, drawn once: friction, torso mass and centre, joint gains."""

import numpy as np

from hugwbc.learned.config import RandomizationConfig
from hugwbc.sim.batch import BatchSimulation


def randomize(simulation: BatchSimulation, config: RandomizationConfig, rng: np.random.Generator) -> np.ndarray:
    """Draw the parameters of every robot of a batch.

    Args:
        simulation: the batch; its model fields become per-robot.
        config: the ranges.
        rng: of the draws.

    Returns:
        Friction coefficient of each robot, shape (count,).
    """
    batch, model, count = simulation.batch, simulation.model, simulation.count
    floor = model.geom("floor").id
    own = np.arange(model.ngeom) != floor
    friction = rng.uniform(*config.friction, count)
    # The floor's own coefficient is below the range and MuJoCo takes the larger, so the robot's decides.
    batch.expand("geom_friction")[:, own, 0] = friction[:, None]
    torso = model.body("torso_link").id
    batch.expand("body_mass")[:, torso] += rng.uniform(*config.torso_mass, count)
    batch.expand("body_ipos")[:, torso] += rng.uniform(-config.torso_centre, config.torso_centre, (count, 3))
    stiffness = rng.uniform(*config.gains, (count, model.nu))
    damping = rng.uniform(*config.gains, (count, model.nu))
    batch.expand("actuator_gainprm")[:, :, 0] *= stiffness
    bias = batch.expand("actuator_biasprm")
    bias[:, :, 1] *= stiffness
    bias[:, :, 2] *= damping
    batch.set_const()
    return friction
