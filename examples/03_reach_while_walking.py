"""Walk while both hands swing about points in front of the body: a command script, hand IK and the `qp` controller.

A script consists of segments; commands and hand targets ramp smoothly from one to the next. Any controller can play it.

    python examples/03_reach_while_walking.py --show
"""

import numpy as np

from hugwbc import Gait, load_robot
from hugwbc.runtime import UpperBodySource, load_controller
from hugwbc.scripts import HandMotion, Script, Segment, Swing
from hugwbc.viz.show import run_script, watch

LEFT = Swing(centre=(0.3, 0.25, 0.2), amplitude=(0.05, 0.0, 0.08), phase=(0.0, 0.0, 0.25), period=3.0)
HANDS = HandMotion(left=LEFT, right=LEFT.mirrored(), frame="pelvis")
STANDING = 1.5  # [s]; the hands have arrived at their paths before the robot walks


def main(duration: float = 6.0, show: bool = False) -> None:
    """Reach, then walk on while reaching.

    Args:
        duration: how long to run [s], at least 2.5.
        show: show the robot live in the browser.
    """
    script = Script(
        "reach and walk",
        (
            Segment("reach", STANDING, Gait.STANDING, hands=HANDS),
            Segment("walk", duration - STANDING, Gait.WALKING, {"v_x": 0.4}, hands=HANDS),
        ),
    )
    controller = load_controller("qp")
    trace = watch(
        controller,
        script,
        upper_body=UpperBodySource(load_robot()),
        duration=script.duration,
        show=show,
        replay="out/03.html",
    )
    error = 1000 * np.mean(trace.hand_error[trace.gait == Gait.WALKING])
    print(f"mean hand error {error:.1f} mm, walked {trace.qpos[-1, 0]:.2f} m")
    print(f"The robot {trace.fate}.")


if __name__ == "__main__":
    run_script(main)
