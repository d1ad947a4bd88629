"""Walk while both hands swing about points in front of the body: a command script, hand IK and the QP controller.

A script is made of segments; between them commands and hand targets ramp smoothly. Any controller can play it.

    python examples/03_reach_while_walking.py --duration 6
"""

import numpy as np
import tyro

from hugwbc import Gait, rotations
from hugwbc.mbc import WholeBodyController
from hugwbc.scripts.hand_paths import Swing
from hugwbc.scripts.script import HandMotion, Script, Segment
from hugwbc.sim import Simulation
from hugwbc.upper_ik import UpperBodySource

LEFT = Swing(centre=(0.3, 0.25, 0.2), amplitude=(0.05, 0.0, 0.08), phase=(0.0, 0.0, 0.25), period=3.0)
HANDS = HandMotion(left=LEFT, right=LEFT.mirrored(), frame="pelvis")


def main(duration: float = 6.0) -> None:
    """Reach, then walk on while reaching.

    Args:
        duration: how long [s], at least 2.5.
    """
    script = Script(
        "reach and walk",
        (
            Segment("reach", 1.5, Gait.STANDING, hands=HANDS),
            Segment("walk", duration - 1.5, Gait.WALKING, {"v_x": 0.4}, hands=HANDS),
        ),
    )
    simulation = Simulation()
    controller = WholeBodyController()
    source = UpperBodySource(gravity_compensation=False)
    state = simulation.reset()
    controller.reset(state)

    errors = []
    for tick in range(round(script.duration / controller.period)):
        t = tick * controller.period
        hands = script.hands_at(t)
        upper_body, command = source.update(state, hands, script.command_at(t), controller.period)
        state = simulation.step(controller.act(state, command, upper_body), controller.period)
        if hands is not None and source.takeover.settled:
            assert state.position is not None
            world = np.array([simulation.hand_position(side) for side in ("left", "right")])
            in_pelvis = rotations.rotate_inverse(state.orientation, world - state.position)
            errors.append(np.linalg.norm(in_pelvis - hands.array(), axis=1))

    assert state.position is not None
    print(f"mean hand error {1000 * np.mean(errors):.1f} mm, walked {state.position[0]:.2f} m")
    print("fallen" if simulation.fallen else "walking")


if __name__ == "__main__":
    tyro.cli(main)
