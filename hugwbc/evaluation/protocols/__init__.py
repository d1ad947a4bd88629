"""The paper's experiments and further ones, each a `Protocol` in a file of its own, registered here by name.

A protocol of another package is an entry point in the group `hugwbc.protocols`: a class, a subclass of `Protocol` that
is made without arguments, or such an object.
"""

import functools
from collections.abc import Mapping
from typing import Any

from hugwbc import extensions
from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.evaluation.protocols.contacts import ContactsProtocol
from hugwbc.evaluation.protocols.disturbance import DisturbanceProtocol
from hugwbc.evaluation.protocols.effort import EffortProtocol
from hugwbc.evaluation.protocols.engines import EnginesProtocol
from hugwbc.evaluation.protocols.estimation import EstimationProtocol
from hugwbc.evaluation.protocols.faults import FaultsProtocol
from hugwbc.evaluation.protocols.foot_displacement import FootDisplacementProtocol
from hugwbc.evaluation.protocols.forces import ForcesProtocol
from hugwbc.evaluation.protocols.hands import HandsProtocol
from hugwbc.evaluation.protocols.heatmap import HeatmapProtocol
from hugwbc.evaluation.protocols.intervention import InterventionProtocol
from hugwbc.evaluation.protocols.protocol import PlannedProtocol, Protocol
from hugwbc.evaluation.protocols.ramp import RampProtocol
from hugwbc.evaluation.protocols.random_commands import RandomCommandsProtocol
from hugwbc.evaluation.protocols.robustness import RobustnessProtocol
from hugwbc.evaluation.protocols.single_command import SingleCommandProtocol
from hugwbc.evaluation.protocols.small_velocities import SmallVelocitiesProtocol
from hugwbc.evaluation.protocols.suite_tasks import TasksProtocol
from hugwbc.evaluation.protocols.tour import TourProtocol

__all__ = ["PROTOCOLS", "PlannedProtocol", "Protocol", "all_protocols", "protocol_names", "protocol_of"]

GROUP = "hugwbc.protocols"

# By name, in the order in which the command line lists them and the report shows them; those of others come after.
PROTOCOLS: Mapping[str, Protocol[Any, Any, Any]] = {
    protocol.name: protocol
    for protocol in (
        SingleCommandProtocol(),
        InterventionProtocol(),
        FootDisplacementProtocol(),
        HeatmapProtocol(),
        DisturbanceProtocol(),
        RampProtocol(),
        TourProtocol(),
        RobustnessProtocol(),
        EffortProtocol(),
        ContactsProtocol(),
        RandomCommandsProtocol(),
        SmallVelocitiesProtocol(),
        HandsProtocol(),
        ForcesProtocol(),
        EstimationProtocol(),
        FaultsProtocol(),
        EnginesProtocol(),
        TasksProtocol(),
    )
}


def protocol_names() -> tuple[str, ...]:
    """Return the names of the protocols of this package, and of those that other packages register."""
    ours = {name: f"{type(protocol).__module__}:{type(protocol).__name__}" for name, protocol in PROTOCOLS.items()}
    return tuple(extensions.registered(GROUP, "protocol", ours))


def all_protocols() -> dict[str, Protocol[Any, Any, Any]]:
    """Return the protocols of this package, and those of other packages after them, by name."""
    return {name: protocol_of(name) for name in protocol_names()}


@functools.cache
def protocol_of(name: str) -> Protocol[Any, Any, Any]:
    """Return a protocol by name."""
    if name in PROTOCOLS:
        return PROTOCOLS[name]
    if name not in protocol_names():
        raise UnknownNameError("protocol", name, protocol_names())
    entry = extensions.registered(GROUP, "protocol")[name]
    found = extensions.load_entry(entry, "protocol")
    origin = f"protocol '{name}' ({entry.value})"
    try:
        protocol = found() if isinstance(found, type) else found
    except TypeError as error:  # it takes arguments, or lacks a method
        raise ConfigError(f"{origin} cannot be made: {error}; see hugwbc.evaluation.protocols.Protocol") from error
    if not isinstance(protocol, Protocol):
        raise ConfigError(f"{origin} is a {type(protocol).__name__}; give a subclass of Protocol")
    missing = [word for word in ("name", "summary", "settings") if not hasattr(protocol, word)]
    if missing:
        raise ConfigError(f"{origin} has no {', '.join(missing)}; see hugwbc.evaluation.protocols.Protocol")
    if protocol.name != name:
        raise ConfigError(f"{origin} calls itself '{protocol.name}'; give both one name")
    return protocol
