"""The paper's experiments and further ones, each an `Experiment` in a file of its own, listed here by name."""

from collections.abc import Mapping
from typing import Any

from hugwbc import extensions
from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.evaluation.experiment import Experiment
from hugwbc.evaluation.experiments import (
    arrive,
    behaviours,
    boxes,
    carry,
    contacts,
    engines,
    estimation,
    faults,
    foot_displacement,
    hands,
    intervention,
    press,
    pull,
    push,
    ramp,
    random_commands,
    response,
    single_command,
    stops,
    suite_tasks,
    sway,
)

# In the order in which the command line lists them and the report shows them.
EXPERIMENTS: Mapping[str, Experiment[Any]] = {
    module.EXPERIMENT.name: module.EXPERIMENT
    for module in (
        single_command,
        intervention,
        foot_displacement,
        ramp,
        contacts,
        random_commands,
        response,
        stops,
        arrive,
        hands,
        carry,
        pull,
        press,
        push,
        sway,
        estimation,
        faults,
        engines,
        suite_tasks,
        behaviours,
        boxes,
    )
}


def experiment_of(name: str) -> Experiment[Any]:
    """Return an experiment by name, or the object of a Python file by `FILE.py:NAME`."""
    if extensions.names_object(name):
        found = extensions.load_object(name, "experiment")
        if not isinstance(found, Experiment):
            raise ConfigError(f"{name} is a {type(found).__name__}; give an Experiment")
        return found
    if name not in EXPERIMENTS:
        raise UnknownNameError("experiment", name, (*EXPERIMENTS, "FILE.py:NAME"))
    return EXPERIMENTS[name]
