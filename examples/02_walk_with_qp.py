"""Walk forward with the `qp` controller, and measure the speed.

python examples/02_walk_with_qp.py --v-x 0.5 --duration 6
"""

import numpy as np
import tyro

from hugwbc import Command, Gait, UpperBody
from hugwbc.mbc import WholeBodyController
from hugwbc.sim import Simulation


def main(v_x: float = 0.5, duration: float = 6.0) -> None:
    """Walk.

    Args:
        v_x: commanded forward velocity [m/s].
        duration: how long [s]; the speed is measured over the second half.
    """
    command = Command(v_x=v_x, gait=Gait.WALKING).validate()
    simulation = Simulation()
    controller = WholeBodyController()
    state = simulation.reset()
    controller.reset(state)

    ticks = round(duration / controller.period)
    positions = []
    for _ in range(ticks):
        joint_command = controller.act(state, command, UpperBody.none())
        state = simulation.step(joint_command, controller.period)
        assert state.position is not None
        positions.append(state.position)

    half = positions[ticks // 2 :]
    speed = float(np.linalg.norm(half[-1][:2] - half[0][:2])) / (controller.period * (len(half) - 1))
    print(f"commanded {v_x:.2f} m/s, walked {speed:.2f} m/s, pelvis at {positions[-1][2]:.2f} m")
    print("fallen" if simulation.fallen else "walking")


if __name__ == "__main__":
    tyro.cli(main)
