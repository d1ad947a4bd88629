"""Carry an imagined box with both hands: a shipped script, and how well the hands keep their distance.

`together` in the script makes the relative position of the hands go before where they are.

    python examples/06_carry_a_box.py
"""

import numpy as np
import tyro

from hugwbc.runtime import rollout, upper_body_source
from hugwbc.runtime.controllers import ControllerSpec
from hugwbc.scripts.script_file import load_script
from hugwbc.sim import Simulation


def main(controller: str = "qp", duration: float | None = None) -> None:
    """Play the script.

    Args:
        controller: qp or learned.
        duration: how much of the script to play [s]; all of it by default.
    """
    script = load_script("carry_box")
    robot, simulation, gaps = ControllerSpec(controller).build(), Simulation(), []

    def watch(_: float) -> None:
        hands = script.hands_at(simulation.data.time)
        if hands is not None and hands.together:
            left, right = (simulation.hand_position(side) for side in ("left", "right"))
            gaps.append(float(np.linalg.norm(left - right)))

    source = upper_body_source(robot)
    trace = rollout(robot, script, simulation, source, duration=duration or script.duration, on_progress=watch)
    if gaps:
        print(f"{len(gaps)} looks at the box: hands {100 * np.mean(gaps):.1f} cm apart on average, ", end="")
        print(f"{100 * np.min(gaps):.1f} to {100 * np.max(gaps):.1f} cm; the box is 32 cm wide")
    else:
        print("so early in the script there is no box yet")
    print("fallen" if trace.fell else f"carried over {np.linalg.norm(trace.qpos[-1, :2]):.2f} m")


if __name__ == "__main__":
    tyro.cli(main)
