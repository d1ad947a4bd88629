"""The runs of a report: every available protocol's quick runs, or those of the paper's size.

The paper says how many rollouts its disturbance figure has (4096) and how long an episode is (1000 steps of 20 ms), but
not how many episodes its tables average over; the full profile takes 256 for each gait.
"""

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from hugwbc.errors import UnknownNameError
from hugwbc.evaluation.engine import Cell
from hugwbc.evaluation.protocols import Protocol, all_protocols, protocol_of
from hugwbc.runtime.controllers import ControllerSpec

Run = tuple[str, Any]  # name of a protocol, and settings of one run


def profile_cells(
    profile: str,
    specs: Sequence[ControllerSpec],
    further: Sequence[ControllerSpec] = (),
    **settings: Any,  # noqa: ANN401
) -> list[Cell]:
    """Return the cells of a profile, those of all controllers side by side, so that an early stop leaves pairs.

    Args:
        profile: one of `PROFILES`.
        specs: the controllers.
        further: policies that take part only in the protocols of the ablation.
        settings: settings of every protocol, such as the seed.
    """
    if profile not in PROFILES:
        raise UnknownNameError("profile", profile, PROFILES)
    return [
        Cell(name, spec, own, protocol.run, protocol.total(own))
        for name, config in PROFILES[profile](settings)
        for protocol in (protocol_of(name),)
        for spec in (*specs, *(further if protocol.ablation else ()))
        for own in (protocol.for_training(config, spec.training),)
    ]


def _quick(settings: Mapping[str, Any]) -> Iterator[Run]:
    for name, protocol in _available():
        yield from ((name, dataclasses.replace(config, **settings)) for config in protocol.quick())


def _full(settings: Mapping[str, Any]) -> Iterator[Run]:
    for name, protocol in _available():
        yield from ((name, dataclasses.replace(config, **settings)) for config in protocol.full())


def _available() -> list[tuple[str, Protocol[Any, Any, Any]]]:
    return [(name, protocol) for name, protocol in all_protocols().items() if not protocol.unavailable()]


PROFILES: Mapping[str, Callable[[Mapping[str, Any]], Iterator[Run]]] = {"quick": _quick, "full": _full}
