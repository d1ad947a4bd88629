"""Walk to a table, take a box of 1 kg between both hands, carry it sideways, set it on a shelf, and wave.

A scene, and a behaviour made of steps; the same for both controllers. With the QP it takes one to three
minutes of computing.

    python examples/12_a_task_of_your_own.py --show
"""

from hugwbc.behaviours import BehaviourSource, Course, View, carry, lift, place, reach, squeeze, stand, walk_to
from hugwbc.runtime import Simulation, UpperBodySource, rollout
from hugwbc.sim.scenes import Box, Scene, Shelf, Table
from hugwbc.viz.show import at_real_time, keep_replay, open_view, run_script

TABLE = Table(name="table", position=(1.6, 0.0), size=(0.5, 0.5), height=0.9)
SHELF = Shelf(name="shelf", position=(1.6, 0.55), size=(0.4, 0.5), boards=(0.9,))
BOX = Box(name="box", on="table", position=(-0.1, 0.0), size=(0.2, 0.24, 0.2), mass=1.0)
SCENE = Scene((TABLE, SHELF, BOX))


def shelve(view: View) -> Course:
    """Put the box on the shelf: every step ends by what happens, and returns what is known then."""
    view = yield from walk_to(view, before="box", distance=0.41)
    view = yield from squeeze(view, "box")
    view = yield from lift(view, "box", 0.1)
    view = yield from carry(view, "box", walk_to(view, before="shelf", distance=0.55, speed=0.2))
    view = yield from place(view, "box", on="shelf", at=(-0.08, 0.0))
    view = yield from stand(view)
    for y in (-0.35, -0.5, -0.35):
        view = yield from reach(view, right=(0.25, y, 0.45))
    return view


def main(controller: str = "qp", seed: int = 0, duration: float = 60.0, show: bool = False) -> None:
    """Do the task.

    Args:
        controller: qp or learned.
        seed: of the sensors.
        duration: longest duration [s]; the run ends when the robot has waved.
        show: show the robot live in the browser.
    """
    source, simulation = BehaviourSource(shelve), Simulation(scene=SCENE, seed=seed)
    draw = at_real_time(open_view(controller, simulation.robot, scene=simulation.scene), simulation) if show else None
    trace = rollout(
        controller,
        source,
        simulation,
        UpperBodySource(simulation.robot),
        duration=duration,
        on_snapshot=draw,
        until=lambda: source.done,
    )
    keep_replay("out/12.html", [trace])
    x, y, z = simulation.objects["box"].position
    print(f"The box is at x = {x:.2f} m, y = {y:.2f} m, {z:.2f} m above the floor.")
    print(f"The robot {trace.fate}; the task is {source.ending}.")


if __name__ == "__main__":
    run_script(main)
