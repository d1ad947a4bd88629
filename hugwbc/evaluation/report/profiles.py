"""What a report runs: protocols, gaits and numbers of episodes, quick or of the paper's size."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

from hugwbc.errors import UnknownNameError
from hugwbc.evaluation.campaign import Cell
from hugwbc.evaluation.controllers import ControllerSpec
from hugwbc.evaluation.protocols import SingleCommandConfig, run_single_command
from hugwbc.evaluation.protocols.contacts import ContactsConfig, run_contacts
from hugwbc.gait import Gait

PROFILES = ("quick", "full")


def profile_cells(profile: str, specs: Sequence[ControllerSpec], **settings: Any) -> list[Cell]:  # noqa: ANN401
    """The cells of a profile, the quick ones of both controllers side by side.

    Args:
        profile: one of `PROFILES`.
        specs: the controllers.
        settings: of every protocol, such as the seed.

    Raises:
        UnknownNameError: if there is no such profile.
    """
    if profile not in PROFILES:
        raise UnknownNameError("profile", profile, PROFILES)
    parts = _quick(settings) if profile == "quick" else _full(settings)
    return [Cell(name, spec, config, run) for name, config, run in parts for spec in specs]


Part = tuple[str, Any, Callable[..., Any]]
_GAITS = (Gait.STANDING, Gait.WALKING, Gait.JUMPING, Gait.HOPPING_LEFT)


def _quick(settings: dict[str, Any]) -> Iterator[Part]:
    episodes = {Gait.STANDING: 6, Gait.WALKING: 16, Gait.JUMPING: 16, Gait.HOPPING_LEFT: 8}
    for gait in _GAITS:
        config = SingleCommandConfig(gait, gait.hops, episodes=episodes[gait], duration=6.0, **settings)
        yield "single-command", config, run_single_command
    yield from _contacts(settings)


def _full(settings: dict[str, Any]) -> Iterator[Part]:
    for gait in _GAITS:
        yield "single-command", SingleCommandConfig(gait, gait.hops, episodes=1024, **settings), run_single_command
    yield from _contacts(settings)


def _contacts(settings: dict[str, Any]) -> Iterator[Part]:
    for gait in Gait:
        yield "contacts", ContactsConfig(gait, **settings), run_contacts
