"""Reach for a point half a metre above the floor: the arms alone cannot, so h, p and w help.

The same targets without and with `whole_body`. The commands that hand IK then chooses would suit any controller. The
replay shows both attempts side by side.

    python examples/05_pick_from_the_floor.py --show
"""

import dataclasses

from hugwbc import Command
from hugwbc.runtime import Constant, UpperBodySource, load_controller
from hugwbc.targets import HandTargets
from hugwbc.viz.show import fate, keep_replay, run_script, watch


def main(height: float = 0.55, duration: float = 5.0, show: bool = False) -> None:
    """Reach down twice.

    Args:
        height: height of the targets above the floor [m].
        duration: how long each attempt lasts [s].
        show: show the robot live in the browser.
    """
    traces = []
    for name, whole_body in (("arms alone", False), ("whole body", True)):
        targets = HandTargets.of((0.45, 0.2, height), (0.45, -0.2, height), "world", whole_body=whole_body)
        controller = load_controller("qp")
        hands = UpperBodySource()
        trace = watch(controller, Constant(Command(), targets), upper_body=hands, duration=duration, show=show)
        traces.append(dataclasses.replace(trace, name=name))
        short = 100 * trace.hand_error[-1].max()
        h, p, w = trace.command[-1, 5:]
        print(f"{name}: {short:.1f} cm short, commanded h {h:.2f} m, p {p:.2f} rad, w {w:.2f} rad, {fate(trace)}")
    keep_replay("out/05.html", traces)
    gain = 100 * (traces[0].hand_error[-1].max() - traces[1].hand_error[-1].max())
    print(f"Crouching and leaning brought the hands {gain:.1f} cm nearer to their targets.")


if __name__ == "__main__":
    run_script(main)
