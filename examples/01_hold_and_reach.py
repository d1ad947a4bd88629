"""Stand still and reach for two points: the left one is within reach, the right one is not.

Hand IK in front of a controller: it turns hand targets into arm targets, takes the arms over without a jump, and tells
which targets cannot be reached.

    python examples/01_hold_and_reach.py --show
"""

from hugwbc import Command, load_robot
from hugwbc.runtime import Constant, UpperBodySource, load_controller
from hugwbc.targets import HandTargets
from hugwbc.viz.show import run_script, watch


def main(duration: float = 4.0, show: bool = False) -> None:
    """Stand and reach.

    Args:
        duration: how long to run [s].
        show: show the robot live in the browser.
    """
    controller = load_controller("qp")
    targets = HandTargets.of(left=(0.35, 0.25, 0.2), right=(0.9, -0.25, 0.2), frame="pelvis")
    trace = watch(
        controller,
        Constant(Command(), targets),
        upper_body=UpperBodySource(load_robot()),
        duration=duration,
        show=show,
        replay="out/01.html",
    )
    for index, side in enumerate(("left", "right")):
        verdict = "within reach" if trace.reachable[-1, index] else "out of reach"
        print(f"{side} hand: {100 * trace.hand_error[-1, index]:.1f} cm from its target, which is {verdict}")
    print(f"The robot {trace.fate}.")


if __name__ == "__main__":
    run_script(main)
