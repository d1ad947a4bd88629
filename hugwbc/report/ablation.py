"""The paper's ablation: what moves the arms in the test, against what moved them in training.

The paper prints its policies of all `TRAININGS`. A policy of ours stands beside the paper's of the same training; a
controller that was not trained beside the best of them. Where there is no policy, the paper's figures stand alone.
"""

from collections.abc import Mapping, Sequence

from hugwbc.commands import COMMAND_UNITS
from hugwbc.evaluation.engine import CellResult
from hugwbc.evaluation.intervals import bootstrap_mean
from hugwbc.evaluation.paper import TRAININGS, foot_displacement, intervention_errors
from hugwbc.gait import Gait
from hugwbc.report.figures import Figure, falls_figure

PROTOCOLS = ("intervention", "foot-displacement")
ARMS = {"noise": "arms moved by noise", "motion": "arms moved by motions", "none": "arms free"}
TRAINED = {"noise": "trained with noise", "motion": "trained with motions", "none": "trained without intervention"}
_COMMAND = {f"E_{name.replace('_', '')}": name for name in COMMAND_UNITS}  # by the paper's name of the error


def intervention_figures(measured: CellResult) -> list[Figure]:
    """Tracking errors by what moves the arms, one table each."""
    result, name, figures = measured.result, measured.controller, []
    trained = TRAINED[result["training"]]
    for arms, errors in result["errors"].items():
        table = _tracking_table(result["gait"], arms)
        rows = [row for row in result["rows"] if row["intervention"] == arms]
        for error in errors:
            estimate = bootstrap_mean([row["error"] for row in rows if row["command"] == _COMMAND[error]])
            paper, unit = result["paper"][arms].get(error), COMMAND_UNITS[_COMMAND[error]]
            figures.append(Figure(table, error, unit, name, estimate, paper, reference=trained))
        figures.append(falls_figure(table, name, rows, trained))
    return figures


def foot_displacement_figures(measured: CellResult) -> list[Figure]:
    """Length of both feet's paths of a standing robot by what moves the arms, in the episodes without a fall."""
    result, name, figures = measured.result, measured.controller, []
    trained = TRAINED[result["training"]]
    for arms, travel in result["displacement"].items():
        table = _displacement_table(arms)
        rows = [row for row in result["rows"] if row["intervention"] == arms]
        for command in travel:
            kept = [row["foot_travel"] for row in rows if row["command"] == command and not row["fell"]]
            paper, quantity = result["paper"][arms].get(command), _commanded(command)
            figures.append(Figure(table, quantity, "m", name, bootstrap_mean(kept), paper, reference=trained))
        figures.append(falls_figure(table, name, rows, trained))
    return figures


def unmeasured_figures(results: Sequence[CellResult]) -> list[Figure]:
    """What the paper prints of the trainings that no result in the same tables is of.

    Args:
        results: of any protocols.
    """
    figures = []
    gaits: dict[str, list[str]] = {}
    for measured in results:
        if measured.protocol == "intervention":
            gaits.setdefault(measured.result["gait"], []).append(measured.result["training"])
    for gait, measured_trainings in gaits.items():
        for training in _others(measured_trainings):
            for arms in ARMS:
                errors = intervention_errors(Gait.parse(gait), arms, training)
                units = {error: COMMAND_UNITS[_COMMAND[error]] for error in errors}
                figures += _alone(_tracking_table(gait, arms), errors, units, training)
    standing = [measured.result["training"] for measured in results if measured.protocol == "foot-displacement"]
    for training in _others(standing) if standing else ():
        for arms in ARMS:
            lengths = {_commanded(name): length for name, length in foot_displacement(arms, training).items()}
            figures += _alone(_displacement_table(arms), lengths, dict.fromkeys(lengths, "m"), training)
    return figures


def _others(trainings: Sequence[str]) -> list[str]:
    return [training for training in TRAININGS if training not in trainings]


def _alone(table: str, values: Mapping[str, float], units: Mapping[str, str], training: str) -> list[Figure]:
    return [
        Figure(table, quantity, units[quantity], "", None, value, reference=TRAINED[training])
        for quantity, value in values.items()
    ]


def _tracking_table(gait: str, arms: str) -> str:
    return f"Intervention, {gait}, {ARMS[arms]}"


def _displacement_table(arms: str) -> str:
    return f"Foot displacement, {ARMS[arms]}"


def _commanded(name: str) -> str:
    return f"{name} commanded"
