"""Walk with a cup in the right hand: it stays level in its place in the heading frame, carried along by the body.

python examples/04_walk_with_a_cup.py --duration 6
"""

import numpy as np
import tyro

from hugwbc import Gait
from hugwbc.mbc import WholeBodyController
from hugwbc.runtime import rollout, upper_body_source
from hugwbc.scripts.hand_paths import Hold
from hugwbc.scripts.script import HandMotion, Script, Segment
from hugwbc.sim import Simulation

CUP = HandMotion(None, Hold((0.35, -0.2, 0.2)), frame="heading", right_direction=(1.0, 0.0, 0.0))


def main(duration: float = 6.0) -> None:
    """Stand, then walk.

    Args:
        duration: how long [s], at least 4.
    """
    stand, walk = Segment("stand", 2.0, hands=CUP), Segment("walk", duration - 2.0, Gait.WALKING, {"v_x": 0.4}, CUP)
    controller, simulation = WholeBodyController(), Simulation()
    script = Script("walk with a cup", (stand, walk))
    trace = rollout(controller, script, simulation, upper_body_source(controller), duration=duration)

    walking = trace.time > 2.5
    error = trace.hand_error[walking, 1]
    _, sideways, up = 1000 * np.ptp(trace.hand_target_world[walking, 1], axis=0)
    print(f"cup {100 * np.mean(error):.1f} cm from its place on average, {100 * np.max(error):.1f} cm at most")
    print(f"with the body it swayed by {sideways:.0f} mm sideways, {up:.0f} mm up and down")
    print("fallen" if trace.fell else f"walked {trace.qpos[-1, 0]:.2f} m")


if __name__ == "__main__":
    tyro.cli(main)
