"""The paper's experiments, one file per table or figure, and the accuracy of the hands, for any controller."""

from hugwbc.evaluation.protocols.contacts import ContactsConfig, ContactsResult, run_contacts
from hugwbc.evaluation.protocols.disturbance import DisturbanceConfig, DisturbanceResult, run_disturbance
from hugwbc.evaluation.protocols.effort import EffortConfig, EffortResult, run_effort
from hugwbc.evaluation.protocols.foot_displacement import (
    FootDisplacementConfig,
    FootDisplacementResult,
    run_foot_displacement,
)
from hugwbc.evaluation.protocols.hands import HandsConfig, HandsResult, run_hands
from hugwbc.evaluation.protocols.heatmap import HeatmapConfig, HeatmapResult, run_heatmap
from hugwbc.evaluation.protocols.intervention import InterventionConfig, InterventionResult, run_intervention
from hugwbc.evaluation.protocols.ramp import RampConfig, RampResult, run_ramp
from hugwbc.evaluation.protocols.random_commands import (
    RandomCommandsConfig,
    RandomCommandsResult,
    run_random_commands,
)
from hugwbc.evaluation.protocols.robustness import RobustnessConfig, RobustnessResult, run_robustness
from hugwbc.evaluation.protocols.single_command import SingleCommandConfig, SingleCommandResult, run_single_command
from hugwbc.evaluation.protocols.small_velocities import (
    SmallVelocitiesConfig,
    SmallVelocitiesResult,
    run_small_velocities,
)
from hugwbc.evaluation.protocols.tour import TourConfig, TourResult, run_tour

__all__ = [
    "ContactsConfig",
    "ContactsResult",
    "DisturbanceConfig",
    "DisturbanceResult",
    "EffortConfig",
    "EffortResult",
    "FootDisplacementConfig",
    "FootDisplacementResult",
    "HandsConfig",
    "HandsResult",
    "HeatmapConfig",
    "HeatmapResult",
    "InterventionConfig",
    "InterventionResult",
    "RampConfig",
    "RampResult",
    "RandomCommandsConfig",
    "RandomCommandsResult",
    "RobustnessConfig",
    "RobustnessResult",
    "SingleCommandConfig",
    "SingleCommandResult",
    "SmallVelocitiesConfig",
    "SmallVelocitiesResult",
    "TourConfig",
    "TourResult",
    "run_contacts",
    "run_disturbance",
    "run_effort",
    "run_foot_displacement",
    "run_hands",
    "run_heatmap",
    "run_intervention",
    "run_ramp",
    "run_random_commands",
    "run_robustness",
    "run_single_command",
    "run_small_velocities",
    "run_tour",
]
