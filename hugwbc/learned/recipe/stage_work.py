"""What the stages of a run have in common: their folder, their inputs and the ledger."""

import dataclasses
import json
import pathlib
from collections.abc import Callable, Mapping
from typing import Any, Protocol

from hugwbc.errors import RecipeError
from hugwbc.files import write_whole
from hugwbc.learned.imitation.imitation import Teacher
from hugwbc.learned.recipe.ancestry import Discarded
from hugwbc.learned.recipe.ledger import Session
from hugwbc.learned.recipe.recipe_records import CalibrationSettings, Recipe, Stage
from hugwbc.learned.stopping import Stop
from hugwbc.robot import Robot

STATE_FILE = "state.json"


class Services(Protocol):
    """What stages need from rooms above `learned`: the QP as a teacher, and evaluations."""

    def teacher(self, robot: Robot) -> Callable[[float], Teacher]:
        """Return what makes a teacher for a control period [s]."""
        ...

    def check_table(self, table: Mapping[str, Any]) -> None:
        """Refuse a table of an evaluation that cannot be run."""
        ...

    def simulated_seconds(self, table: Mapping[str, Any]) -> float:
        """Return how much a table simulates [s]."""
        ...

    def run_table(
        self,
        policy: pathlib.Path,
        table: Mapping[str, Any],
        *,
        seed: int,
        workers: int,
        folder: pathlib.Path,
        on_episode: Callable[[], None],
    ) -> dict[str, Any]:
        """Run a table with a policy and return its result as JSON; finished episodes are kept in the folder.

        Args:
            policy: path of the policy file.
            table: protocol and its settings.
            seed: seed of the episodes.
            workers: processes that share the episodes.
            folder: where finished episodes are kept, so that they are not run again.
            on_episode: called after each episode.
        """
        ...

    def executed(
        self, policy: pathlib.Path, commands: list[dict[str, Any]], settings: CalibrationSettings, workers: int
    ) -> list[dict[str, float]]:
        """Return what a policy executes under some commands, one episode each: means by name, NaN after a fall.

        Args:
            policy: path of the policy file.
            commands: gait and values of each command; the others are at their defaults.
            settings: arena, seed and length of the episodes.
            workers: processes that share the episodes.
        """
        ...


@dataclasses.dataclass
class StageWork:
    """A stage at work.

    Attributes:
        recipe: the recipe.
        stage: the stage.
        folder: folder of its files.
        inputs: path of each input.
        session: the ledger.
        services: what it needs from other rooms.
        stop: the wish to stop.
        progress: called with the fraction of the stage that is done.
        say: prints a line.
        workers: processes that evaluations share; None for the setting of the stage.
    """

    recipe: Recipe
    stage: Stage
    folder: pathlib.Path
    inputs: Mapping[str, pathlib.Path]
    session: Session
    services: Services
    stop: Stop
    progress: Callable[[float], None]
    say: Callable[[str], None]
    workers: int | None = None

    @property
    def paths(self) -> dict[str, pathlib.Path]:
        """The inputs that are settings."""
        names = {field.name for field in dataclasses.fields(self._settings)}
        return {name: path for name, path in self.inputs.items() if name.partition(".")[0] in names}

    @property
    def _settings(self) -> type[Any]:
        from hugwbc.learned.recipe.recipe_records import KINDS

        return KINDS[self.stage.kind].settings

    def seed(self) -> int:
        """Return the seed of the stage: its own, or the recipe's."""
        return int(self.stage.settings.get("seed", self.recipe.seed))


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What a stage came to.

    Attributes:
        how: as in `Record.outcome`.
        steps, labels: work that led to its files.
        discarded: work that did not.
        figures: what was measured.
        seeds: seeds of its random numbers.
    """

    how: str = "finished"
    steps: float = 0.0
    labels: float = 0.0
    discarded: tuple[Discarded, ...] = ()
    figures: Mapping[str, float] = dataclasses.field(default_factory=dict)
    seeds: tuple[int, ...] = ()


def write_state(folder: pathlib.Path, state: Mapping[str, Any]) -> None:
    """Write how far a stage is."""
    write_whole(folder / STATE_FILE, json.dumps(state, indent=1) + "\n")


def read_state(folder: pathlib.Path) -> dict[str, Any]:
    """Return how far a stage is; an empty state if it has not begun.

    Raises:
        RecipeError: if the file is damaged.
    """
    path = folder / STATE_FILE
    if not path.exists():
        return {}
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(content, dict):
            raise ValueError("not a JSON object")
    except (OSError, ValueError) as error:
        raise RecipeError(
            f"{path} is damaged ({error}); copy it back, or begin the stage again with `--redo {folder.name}`"
        ) from error
    return content
