"""Drive the robot from a page: sliders, gait buttons, a push, draggable hands. Needs the extra [live].

python examples/09_drive_live.py --show
"""

import webbrowser

from hugwbc.runtime import ControlLoop, Simulation, UpperBodySource
from hugwbc.viz.live import LivePage
from hugwbc.viz.show import drive, run_script


def main(controller: str = "qp", duration: float = 60.0, show: bool = False) -> None:
    """Serve the page and run the robot in real time, until the time is over or Ctrl-C.

    Args:
        controller: qp or learned.
        duration: how long to run [s]. A robot that falls stands up again.
        show: open the page in the browser; otherwise only its address is printed.
    """
    simulation = Simulation()
    page = LivePage(simulation, name=controller)
    loop = ControlLoop(controller, page.source, simulation, UpperBodySource(simulation.robot))
    print(f"drive at {page.address}", flush=True)
    if show:
        webbrowser.open(page.address)
    try:
        drive(loop, page, duration, perform=lambda task: f"this page offers no {task}")
    finally:
        page.close()


if __name__ == "__main__":
    run_script(main)
