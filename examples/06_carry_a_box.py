"""Carry a box from one table to another, between both hands, by friction: an episode of the task `fetch_box`.

The scene varies with the seed: heights of the tables, and width, mass and friction of the box. The robot is not told
mass and friction. With the QP it takes one to three minutes of computing.

    python examples/06_carry_a_box.py --show
"""

import dataclasses

import numpy as np

from hugwbc.runtime import load_controller
from hugwbc.sim import Simulation
from hugwbc.tasks import load_task, run_task
from hugwbc.viz.show import at_real_time, keep_replay, open_view, run_script


def main(controller: str = "qp", seed: int = 0, duration: float | None = None, show: bool = False) -> None:
    """Do the task.

    Args:
        controller: qp or learned.
        seed: of the scene and of the sensors.
        duration: longest duration [s]; the task's time limit by default.
        show: show the robot live in the browser.
    """
    task, chosen = load_task("fetch_box"), load_controller(controller)
    if duration is not None:
        task = dataclasses.replace(task, limit=duration)
    simulation = Simulation(scene=task.scene, seed=seed)
    draw = at_real_time(open_view(chosen.name, simulation.robot, scene=simulation.scene), simulation) if show else None
    run = run_task(task, chosen, simulation, on_snapshot=draw)
    keep_replay("out/06.html", [run.trace])

    record, box = run.record, run.record.thing("box")
    path = record.poses["box"][:, :3]
    distance = np.linalg.norm(path[-1, :2] - path[0, :2])
    force = np.linalg.norm(record.hand_force, axis=2).max()
    print(f"a box of {100 * box.size[1]:.0f} cm and {box.mass:.1f} kg, squeezed with {force:.0f} N at most")
    print(f"It was lifted by {100 * (path[:, 2].max() - path[0, 2]):.0f} cm and brought {distance:.2f} m away.")
    outcome = "done" if run.verdict.success else f"not done: {run.verdict.reason}"
    print(f"The robot {run.trace.fate}; the task is {outcome}.")


if __name__ == "__main__":
    run_script(main)
