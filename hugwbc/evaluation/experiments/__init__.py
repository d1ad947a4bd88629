"""The paper's experiments and further ones, listed here by name."""

from collections.abc import Mapping
from typing import Any

from hugwbc import extensions
from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.evaluation.episode import Settings
from hugwbc.evaluation.experiment import Experiment
from hugwbc.evaluation.experiments import (
    contacts,
    disturbance,
    engines,
    estimation,
    faults,
    hands,
    ramp,
    random_commands,
    response,
    single_command,
    stops,
    suite_tasks,
)
from hugwbc.evaluation.experiments.behaviours import ARRIVE, BEHAVIOURS, BOXES
from hugwbc.evaluation.experiments.forces import CARRY, PRESS, PULL, PUSH, SWAY
from hugwbc.evaluation.experiments.intervention import INTERVENTION

# In the order in which the command line lists them and the report shows them.
EXPERIMENTS: Mapping[str, Experiment[Any]] = {
    experiment.name: experiment
    for experiment in (
        single_command.EXPERIMENT,
        INTERVENTION,
        disturbance.EXPERIMENT,
        ramp.EXPERIMENT,
        contacts.EXPERIMENT,
        random_commands.EXPERIMENT,
        response.EXPERIMENT,
        stops.EXPERIMENT,
        ARRIVE,
        hands.EXPERIMENT,
        CARRY,
        PULL,
        PRESS,
        PUSH,
        SWAY,
        estimation.EXPERIMENT,
        faults.EXPERIMENT,
        engines.EXPERIMENT,
        suite_tasks.EXPERIMENT,
        BEHAVIOURS,
        BOXES,
    )
}


def experiment_of(name: str) -> Experiment[Any]:
    """Return an experiment by name, or the object of a Python file by `FILE.py:NAME`."""
    if extensions.names_object(name):
        found = extensions.load_object(name, "experiment")
        if not isinstance(found, Experiment):
            raise ConfigError(f"{name} is a {type(found).__name__}; give an Experiment")
        if not (isinstance(found.settings, type) and issubclass(found.settings, Settings)):
            raise ConfigError(f"the settings of {name} are {found.settings!r}; give a class based on CountedSettings")
        return found
    if name not in EXPERIMENTS:
        raise UnknownNameError("experiment", name, (*EXPERIMENTS, "FILE.py:NAME"))
    return EXPERIMENTS[name]
