"""Play one script with the learned policy and with the QP, and compare their figures; the replay shows both.

python examples/07_compare_controllers.py --script wave --show
"""

from hugwbc import load_robot
from hugwbc.evaluation.comparison import summarise
from hugwbc.runtime import UpperBodySource, load_controller
from hugwbc.scripts import load_script
from hugwbc.viz.show import keep_replay, run_script, watch


def main(script: str = "wave", show: bool = False) -> None:
    """Compare.

    Args:
        script: name of a shipped script, or a YAML file.
        show: show one robot after the other live in the browser.
    """
    played, traces = load_script(script), []
    for name in ("learned", "qp"):
        controller = load_controller(name)
        hands = UpperBodySource(load_robot())
        traces.append(watch(controller, played, upper_body=hands, duration=played.duration, show=show))
    keep_replay("out/07.html", traces)
    outcomes = {trace.name: summarise(trace) for trace in traces}
    for trace in traces:
        hand = outcomes[trace.name]["hand_error_m"]["mean"]
        reach = "no hand targets" if hand is None else f"hands {100 * hand:.1f} cm from their targets"
        errors, tick = outcomes[trace.name]["errors"], outcomes[trace.name]["tick_ms"]["p50"]
        print(f"{trace.name}: {trace.fate}, {reach}, waist {errors['w']:.3f} rad off, {tick:.2f} ms a tick")
    if not any(trace.fell for trace in traces):  # errors end with a fall
        closer = min(outcomes, key=lambda name: outcomes[name]["errors"]["h"])
        print(f"The {closer} controller kept closer to the commanded height.")


if __name__ == "__main__":
    run_script(main)
