"""Drive the robot from a page: sliders, gait buttons, a push, draggable hands. Needs the extra [live].

    python examples/09_drive_live.py

`--duration 3` stops after three seconds, as the tests do.
"""

import time

import tyro

from hugwbc.runtime import ControlLoop, upper_body_source
from hugwbc.runtime.controllers import ControllerSpec
from hugwbc.sim import Simulation
from hugwbc.viz.live import LivePage


def main(controller: str = "qp", duration: float = 3600.0) -> None:
    """Serve the page and run the robot in real time.

    Args:
        controller: qp or learned.
        duration: how long [s].
    """
    robot, simulation = ControllerSpec(controller).build(), Simulation()
    page = LivePage(simulation, name=robot.name)
    loop = ControlLoop(robot, page.source, simulation, upper_body_source(robot))
    print(f"drive at {page.address}", flush=True)
    loop.reset()
    begin, tick = time.monotonic(), 0
    while simulation.data.time < duration and not simulation.fallen:
        loop.step(loop.decide(tick * loop.period), loop.period)
        tick += 1
        if tick % max(1, round(0.04 / loop.period)) == 0:
            page.disturb(simulation)
            page.show(simulation)
            time.sleep(max(0.0, begin + simulation.data.time - time.monotonic()))
    print(f"{simulation.data.time:.1f} s, {'fallen' if simulation.fallen else 'standing'}")
    page.close()


if __name__ == "__main__":
    tyro.cli(main)
