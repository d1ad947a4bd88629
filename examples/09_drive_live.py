"""Drive the robot from a page: sliders, gait buttons, a push, draggable hands. Needs the extra [live].

The replay of what you did is in out/09.html afterwards.

    python examples/09_drive_live.py --show
"""

import webbrowser

import numpy as np

from hugwbc import load_robot
from hugwbc.runtime import Simulation, Snapshot, UpperBodySource, load_controller, rollout
from hugwbc.viz.live import LivePage
from hugwbc.viz.show import RealTime, at_real_time, keep_replay, run_script


def main(controller: str = "qp", duration: float = 60.0, show: bool = False) -> None:
    """Serve the page and run the robot in real time.

    Args:
        controller: qp or learned.
        duration: how long to run [s].
        show: open the page in the browser; otherwise only its address is printed.
    """
    robot, simulation = load_controller(controller), Simulation()
    page = LivePage(simulation, name=robot.name)
    print(f"drive at {page.address}", flush=True)
    if show:
        webbrowser.open(page.address)

    clock = RealTime()

    def draw(_: Snapshot) -> None:
        page.disturb(simulation)
        page.show(simulation, speed=clock.speed)

    hands, in_time = UpperBodySource(load_robot()), at_real_time(draw, simulation, clock)
    trace = rollout(robot, page.source, simulation, hands, duration=duration, on_snapshot=in_time)
    page.close()
    keep_replay("out/09.html", [trace])
    way = np.sum(np.linalg.norm(np.diff(trace.qpos[:, :2], axis=0), axis=1))
    print(f"You drove the robot over {way:.2f} m, and it {trace.fate}.")


if __name__ == "__main__":
    run_script(main)
