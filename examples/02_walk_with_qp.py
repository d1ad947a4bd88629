"""Walk forward with the `qp` controller, and measure the speed.

python examples/02_walk_with_qp.py --v-x 0.5 --show
"""

from hugwbc import Command, Gait
from hugwbc.runtime import load_controller
from hugwbc.viz.show import run_script, watch


def main(v_x: float = 0.5, duration: float = 6.0, show: bool = False) -> None:
    """Walk.

    Args:
        v_x: forward velocity to command [m/s].
        duration: how long to run [s]; the speed is measured over the second half.
        show: show the robot live in the browser.
    """
    command = Command(v_x=v_x, gait=Gait.WALKING).validate()
    trace = watch(load_controller("qp"), command, duration=duration, show=show, replay="out/02.html")

    speed = trace.measured[len(trace.time) // 2 :, 0].mean()
    steps = sum(len(times) for times in trace.touch_downs)
    print(f"commanded {v_x:.2f} m/s, walked {speed:.2f} m/s, pelvis at {trace.qpos[-1, 2]:.2f} m")
    print(f"The robot took {steps} steps, moved {trace.qpos[-1, 0]:.2f} m ahead and {trace.fate}.")


if __name__ == "__main__":
    run_script(main)
