"""Walk with a cup in the right hand: it stays level at its place in the heading frame, carried along by the body.

python examples/04_walk_with_a_cup.py --show
"""

import numpy as np

from hugwbc import Gait
from hugwbc.runtime import UpperBodySource, load_controller
from hugwbc.scripts import HandMotion, Hold, Script, Segment
from hugwbc.viz.show import fate, run_script, watch

CUP = HandMotion(None, Hold((0.35, -0.2, 0.2)), frame="heading", right_direction=(1.0, 0.0, 0.0))


def main(duration: float = 6.0, show: bool = False) -> None:
    """Stand, then walk.

    Args:
        duration: how long to run [s], at least 4.
        show: show the robot live in the browser.
    """
    stand, walk = Segment("stand", 2.0, hands=CUP), Segment("walk", duration - 2.0, Gait.WALKING, {"v_x": 0.4}, CUP)
    script, controller = Script("walk with a cup", (stand, walk)), load_controller("qp")
    hands = UpperBodySource()
    trace = watch(controller, script, upper_body=hands, duration=duration, show=show, replay="out/04.html")

    walking = trace.gait == Gait.WALKING
    error = 100 * trace.hand_error[walking, 1]
    _, sideways, up = 1000 * np.ptp(trace.hand_target_world[walking, 1], axis=0)
    print(f"cup {np.mean(error):.1f} cm from its place on average, {np.max(error):.1f} cm at most")
    print(f"with the body it swayed by {sideways:.0f} mm sideways, {up:.0f} mm up and down")
    print(f"The robot walked {trace.qpos[-1, 0]:.2f} m with the cup and {fate(trace)}.")


if __name__ == "__main__":
    run_script(main)
