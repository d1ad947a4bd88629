"""Play one script with the learned policy and with the QP, and put their figures side by side.

python examples/07_compare_controllers.py --script wave
"""

import tyro

from hugwbc.evaluation.comparison import compare, summarise
from hugwbc.runtime.controllers import ControllerSpec
from hugwbc.scripts.script_file import load_script


def main(script: str = "wave") -> None:
    """Compare.

    Args:
        script: name of a shipped script, or a YAML file.
    """
    controllers = [ControllerSpec(name).build() for name in ("learned", "qp")]
    for trace in compare(controllers, load_script(script)):
        outcome = summarise(trace)
        hand = outcome.hand_error_m["mean"]
        reach = "no hand targets" if hand is None else f"hands {100 * hand:.1f} cm from their targets"
        print(
            f"{trace.name}: {'fell' if outcome.fell else 'did not fall'} in {outcome.survived_s:.1f} s, {reach}, ",
            end="",
        )
        print(f"waist {outcome.errors['w']:.3f} rad off, {outcome.tick_ms['p50']:.2f} ms a tick")


if __name__ == "__main__":
    tyro.cli(main)
