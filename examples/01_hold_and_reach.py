"""Stand still and reach for two points: the left one is within reach, the right one is not.

Shows hand IK in front of a controller: `UpperBodySource` turns hand targets into arm targets, takes the arms over
without a jump, and tells what cannot be reached.

    python examples/01_hold_and_reach.py --duration 3
"""

import numpy as np
import tyro

from hugwbc import Command, rotations
from hugwbc.mbc import WholeBodyController
from hugwbc.sim import Simulation
from hugwbc.targets import HandTargets
from hugwbc.upper_ik import UpperBodySource


def main(duration: float = 3.0) -> None:
    """Stand and reach.

    Args:
        duration: how long [s].
    """
    simulation = Simulation()
    controller = WholeBodyController()
    source = UpperBodySource(gravity_compensation=False)  # the QP carries the arms' weight by torque
    targets = HandTargets.of(left=(0.35, 0.25, 0.2), right=(0.9, -0.25, 0.2), frame="pelvis")

    state = simulation.reset()
    controller.reset(state)
    for _ in range(round(duration / controller.period)):
        upper_body, command = source.update(state, targets, Command(), controller.period)
        state = simulation.step(controller.act(state, command, upper_body), controller.period)

    solution = source.solution
    assert solution is not None and state.position is not None
    for index, (side, target) in enumerate(zip(("left", "right"), targets.array(), strict=True)):
        hand = rotations.rotate_inverse(state.orientation, simulation.hand_position(side) - state.position)
        verdict = "within reach" if solution.reachable[index] else "out of reach"
        print(f"{side} hand: {100 * np.linalg.norm(hand - target):.1f} cm from its target, which is {verdict}")
    print("fallen" if simulation.fallen else "standing")


if __name__ == "__main__":
    tyro.cli(main)
