"""Walk to a table, take a box of 1 kg between both hands, carry it sideways, set it on a shelf, and wave.

A scene, and a list of steps that end by what happens; the same for both controllers. With the QP it takes one to three
minutes of computing.

    python examples/12_a_task_of_your_own.py --show
"""

from hugwbc.runtime import Simulation, UpperBodySource, load_controller, rollout
from hugwbc.scripts.behaviours import BehaviourSource, Carry, Lift, Place, Reach, Sequence, Squeeze, Stand, WalkTo
from hugwbc.sim.scenes import Box, Scene, Shelf, Table
from hugwbc.viz.show import at_real_time, fate, keep_replay, open_view, run_script

TABLE = Table(name="table", position=(1.6, 0.0), size=(0.5, 0.5), height=0.9)
SHELF = Shelf(name="shelf", position=(1.6, 0.55), size=(0.4, 0.5), boards=(0.9,))
BOX = Box(name="box", on="table", position=(-0.1, 0.0), size=(0.2, 0.24, 0.2), mass=1.0)
SCENE = Scene((TABLE, SHELF, BOX))


def steps() -> Sequence:
    """Return what the robot does; the same steps could stand in a YAML file."""
    take = WalkTo(before="box", distance=0.41), Squeeze("box"), Lift("box", 0.1)
    carry = Carry("box", before="shelf", distance=0.55, speed=0.2), Place("box", on="shelf", at=(-0.08, 0.0))
    wave = [Reach(right=(0.25, y, 0.45)) for y in (-0.35, -0.5, -0.35)]
    return Sequence(*take, *carry, Stand(), *wave)


def main(controller: str = "qp", seed: int = 0, duration: float = 60.0, show: bool = False) -> None:
    """Do the task.

    Args:
        controller: qp or learned.
        seed: of the sensors.
        duration: longest duration [s]; the run ends when the robot has waved.
        show: show the robot live in the browser.
    """
    source, robot = BehaviourSource(steps()), load_controller(controller)
    simulation = Simulation(scene=SCENE, seed=seed)
    draw = at_real_time(open_view(robot.name, scene=simulation.scene), simulation) if show else None
    trace = rollout(
        robot, source, simulation, UpperBodySource(), duration=duration, on_moment=draw, until=lambda: source.done
    )
    keep_replay("out/12.html", [trace])
    x, y, z = simulation.objects["box"].position
    print(f"The box is at x = {x:.2f} m, y = {y:.2f} m, {z:.2f} m above the floor.")
    print(f"The robot {fate(trace)}; the task is {source.ending}.")


if __name__ == "__main__":
    run_script(main)
