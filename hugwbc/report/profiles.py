"""What a report runs: protocols, gaits and numbers of episodes, quick or of the paper's size.

The paper says how many rollouts its disturbance figure has (4096) and how long an episode is (1000 steps of 20 ms), and
not how many episodes stand behind its tables; `full` takes 256 a gait.
"""

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from hugwbc.errors import UnknownNameError
from hugwbc.evaluation import protocols
from hugwbc.evaluation.engine import Cell
from hugwbc.gait import Gait
from hugwbc.report import ablation
from hugwbc.runtime.controllers import ControllerSpec

Part = tuple[str, Any, Callable[..., Any]]
_HOPPING = Gait.HOPPING_LEFT  # stands for both legs
_GAITS = (Gait.STANDING, Gait.WALKING, Gait.JUMPING, _HOPPING)
_QUICK_EPISODES = {Gait.STANDING: 6, Gait.WALKING: 16, Gait.JUMPING: 16, _HOPPING: 8}


def profile_cells(
    profile: str,
    specs: Sequence[ControllerSpec],
    further: Sequence[ControllerSpec] = (),
    **settings: Any,  # noqa: ANN401
) -> list[Cell]:
    """The cells of a profile; those of all controllers side by side, so that an early stop leaves pairs.

    Args:
        profile: one of `PROFILES`.
        specs: the controllers.
        further: policies that have part in the protocols of the ablation alone.
        settings: of every protocol, such as the seed.

    Raises:
        UnknownNameError: if there is no such profile.
    """
    if profile not in PROFILES:
        raise UnknownNameError("profile", profile, PROFILES)
    return [
        Cell(name, spec, _beside(spec, config) if name in ablation.PROTOCOLS else config, run)
        for name, config, run in PROFILES[profile](settings)
        for spec in (*specs, *(further if name in ablation.PROTOCOLS else ()))
    ]


def _beside(spec: ControllerSpec, config: protocols.InterventionConfig) -> protocols.InterventionConfig:
    """Settings with the paper's policy that a controller is held against."""
    return dataclasses.replace(config, training=spec.training or config.training)


def _quick(settings: Mapping[str, Any]) -> Iterator[Part]:
    for gait in _GAITS:
        config = protocols.SingleCommandConfig(
            gait, gait.hops, episodes=_QUICK_EPISODES[gait], duration=5.0, **settings
        )
        yield "single-command", config, protocols.run_single_command
    for gait, episodes in ((Gait.STANDING, 9), (Gait.WALKING, 24), (Gait.JUMPING, 24)):
        config = protocols.InterventionConfig(gait, episodes=episodes, duration=5.0, **settings)
        yield "intervention", config, protocols.run_intervention
    yield "foot-displacement", protocols.FootDisplacementConfig(episodes=9, **settings), protocols.run_foot_displacement
    # Jumping has as many pairs as walking: left to the full profile, as is hopping.
    for gait, points in ((Gait.STANDING, 3), (Gait.WALKING, 2)):
        config = protocols.HeatmapConfig(gait, points=points, duration=2.5, **settings)
        yield "heatmap", config, protocols.run_heatmap
    # One rollout a force: the force with which one robot falls, far from a survival of 98 %.
    config = protocols.DisturbanceConfig(rollouts=1, first=80.0, resolution=0.25, duration=4.0, **settings)
    yield "disturbance", config, protocols.run_disturbance
    yield from _ramps(2, {**settings, "duration": 10.0})
    yield "tour", protocols.TourConfig(episodes=1, **settings), protocols.run_tour
    config = protocols.RobustnessConfig(Gait.STANDING, samples=3, duration=2.5, **settings)
    yield "robustness", config, protocols.run_robustness
    config = protocols.EffortConfig(Gait.WALKING, speeds=(0.0, 0.5, 1.0), duration=5.0, **settings)
    yield "effort", config, protocols.run_effort
    yield from _contacts(settings)


def _full(settings: Mapping[str, Any]) -> Iterator[Part]:
    for gait in _GAITS:
        config = protocols.SingleCommandConfig(gait, gait.hops, episodes=256, duration=21.0, **settings)
        yield "single-command", config, protocols.run_single_command
    for gait in (Gait.STANDING, Gait.WALKING, Gait.JUMPING):
        config = protocols.InterventionConfig(gait, episodes=3 * 256, duration=21.0, **settings)
        yield "intervention", config, protocols.run_intervention
    config = protocols.FootDisplacementConfig(episodes=3 * 96, **settings)
    yield "foot-displacement", config, protocols.run_foot_displacement
    for gait in _GAITS:
        yield "heatmap", protocols.HeatmapConfig(gait, gait.hops, points=7, **settings), protocols.run_heatmap
    config = protocols.DisturbanceConfig(rollouts=4096, **settings)
    yield "disturbance", config, protocols.run_disturbance
    yield from _ramps(5, settings)
    yield "tour", protocols.TourConfig(episodes=64, **settings), protocols.run_tour
    for gait in (Gait.STANDING, Gait.WALKING):
        yield "robustness", protocols.RobustnessConfig(gait, samples=64, **settings), protocols.run_robustness
    for gait in (Gait.STANDING, Gait.WALKING, Gait.JUMPING):
        yield "effort", protocols.EffortConfig(gait, **settings), protocols.run_effort
    yield from _contacts(settings)


def _ramps(episodes: int, settings: Mapping[str, Any]) -> Iterator[Part]:
    for gait in (Gait.STANDING, Gait.WALKING, Gait.JUMPING):
        yield "ramp", protocols.RampConfig(gait, episodes=episodes, **settings), protocols.run_ramp


def _contacts(settings: Mapping[str, Any]) -> Iterator[Part]:
    for gait in Gait:
        yield "contacts", protocols.ContactsConfig(gait, **settings), protocols.run_contacts


PROFILES: Mapping[str, Callable[[Mapping[str, Any]], Iterator[Part]]] = {"quick": _quick, "full": _full}
