"""Reach for a point half a metre above the floor: the arms alone cannot, so h, p and w help.

The same targets with and without `whole_body`; the commands that it chooses would go to any controller.

    python examples/05_pick_from_the_floor.py --height 0.55
"""

import tyro

from hugwbc import Command
from hugwbc.mbc import WholeBodyController
from hugwbc.runtime import Constant, rollout, upper_body_source
from hugwbc.sim import Simulation
from hugwbc.targets import HandTargets


def main(height: float = 0.55, duration: float = 5.0) -> None:
    """Reach down twice.

    Args:
        height: of the targets above the floor [m].
        duration: of each attempt [s].
    """
    for whole_body in (False, True):
        left, right = (0.45, 0.2, height), (0.45, -0.2, height)
        targets = HandTargets.of(left, right, "world", whole_body=whole_body)
        controller = WholeBodyController()
        source = upper_body_source(controller)
        trace = rollout(controller, Constant(Command(), targets), Simulation(), source, duration=duration)
        assert source.solution is not None
        residual = 100.0 * source.solution.residual.max()
        h, p, w = trace.command[-1, 5:]
        print(f"{'whole body' if whole_body else 'arms alone'}: {residual:.1f} cm left, ", end="")
        print(f"commanded h {h:.2f} m, p {p:.2f} rad, w {w:.2f} rad, {'fallen' if trace.fell else 'standing'}")


if __name__ == "__main__":
    tyro.cli(main)
