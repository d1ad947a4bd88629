"""Draw the response map of docs/comparison.md: how both controllers answer each command of a walk.

It runs `hugwbc evaluate response` for both, or reads the episodes that `make results` has stored.
"""

import pathlib

from matplotlib.figure import Figure

from hugwbc.commands import COMMAND_UNITS
from hugwbc.evaluation.experiment import frame_of, run_experiment
from hugwbc.evaluation.experiments.response import EXPERIMENT, ResponseSettings
from hugwbc.evaluation.store import Store
from hugwbc.runtime.controllers import ControllerSpec
from hugwbc.settings import REPORT_SEED
from hugwbc.viz.framing import LABEL_COLOURS

PICTURE = pathlib.Path(__file__).parent / "images" / "response.png"
CONTROLLERS = {"QP": "qp", "policy": "learned"}


def main() -> None:
    """Plot executed over commanded values, a panel for each command."""
    settings = ResponseSettings(seed=REPORT_SEED)
    rows = {
        label: frame_of(run_experiment(EXPERIMENT, settings, ControllerSpec(name), store=Store()).rows)
        for label, name in CONTROLLERS.items()
    }
    figure = Figure(figsize=(11, 5.2), layout="constrained")
    names = rows["QP"]["command"].unique(maintain_order=True).to_list()
    for axes, name in zip(figure.subplots(2, len(names) // 2).flat, names, strict=True):
        for (label, frame), colour in zip(rows.items(), LABEL_COLOURS, strict=False):
            part = frame.filter(frame["command"] == name).sort("value")
            axes.plot(part["value"], part["value"], color="black", linestyle="--", linewidth=1.0)
            axes.plot(part["value"], part["executed"], color=colour, marker="o", markersize=4, label=label)
        axes.set(xlabel=f"commanded {name} [{COMMAND_UNITS[name]}]", ylabel="executed")
        axes.grid(alpha=0.3)
    figure.axes[0].legend(frameon=False)
    figure.savefig(PICTURE, dpi=100)


if __name__ == "__main__":
    main()
