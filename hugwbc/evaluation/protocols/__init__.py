"""The paper's experiments and further ones, each a `Protocol` in a file of its own, registered here by name."""

from collections.abc import Mapping
from typing import Any

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

__all__ = ["PROTOCOLS", "PlannedProtocol", "Protocol"]

# By name, in the order in which the command line lists them and the report shows them.
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
