"""What recipes need from this room and from the QP: teachers, tables at the report seed, executed commands."""

import dataclasses
import itertools
import pathlib
import typing
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from hugwbc.commands import COMMAND_NAMES, Command, default_command
from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.engine import EpisodePlan, Execution, ResultStore, Run, run_episodes
from hugwbc.evaluation.engine.episode import EpisodeSettings
from hugwbc.evaluation.metrics import SETTLE_S, stepping_feet, touch_downs
from hugwbc.evaluation.protocols import protocol_of
from hugwbc.files import finite_json
from hugwbc.gait import Gait
from hugwbc.kinematics import MEASURED_NAMES
from hugwbc.learned.imitation.imitation import Teacher
from hugwbc.learned.recipe.recipe_records import CalibrationSettings
from hugwbc.robot import Robot
from hugwbc.runtime.controllers import ControllerSpec
from hugwbc.runtime.trace import Trace
from hugwbc.seeds import REPORT_SEED

BOTH_LEGS = "hopping"
_OWN = ("seed", "execution", "conditions", "both_legs")  # fields that a table does not give
Table = Mapping[str, Any]


@dataclasses.dataclass(frozen=True)
class Executed:
    """What a robot executed in an episode.

    Attributes:
        means: mean of v_x, v_y, omega, h, p, w and l after the settling time, NaN after a fall.
    """

    means: dict[str, float]


def executed_means(trace: Trace, settle: float = SETTLE_S) -> dict[str, float]:
    """Return the means of the executed commands after `settle` [s]; of l, that of the highest clearances of swings."""
    kept = trace.time >= settle
    if trace.fell or not kept.any():
        return dict.fromkeys((*MEASURED_NAMES, "l"), float("nan"))
    means = dict(zip(MEASURED_NAMES, trace.measured[kept].mean(axis=0).tolist(), strict=True))
    heights = []
    for foot in stepping_feet(Gait(int(trace.gait[-1]))):
        for begin, end in itertools.pairwise(touch_downs(trace, foot, settle)):
            cycle = (trace.time >= begin) & (trace.time <= end)
            heights.append(float(trace.clearance[cycle, foot].max()))
    return means | {"l": float(np.mean(heights)) if heights else float("nan")}


def _judge(index: int, run: Run) -> Executed:
    return Executed(executed_means(run.trace))


class RecipeServices:
    """`hugwbc.learned.recipe.stage_work.Services`: the QP as a teacher, and this room's protocols."""

    def teacher(self, robot: Robot) -> Callable[[float], Teacher]:
        """Return what makes a QP for a control period [s]."""
        from hugwbc.mbc import WholeBodyController

        return lambda period: WholeBodyController(period=period, robot=robot)

    def check_table(self, table: Table) -> None:
        """Refuse a table that cannot be run.

        Raises:
            UnknownNameError: if the protocol, the gait or a setting does not exist.
            ConfigError: if a value is out of range.
        """
        settings_of(table, REPORT_SEED)

    def simulated_seconds(self, table: Table) -> float:
        """Return how much a table simulates [s]."""
        settings = settings_of(table, REPORT_SEED)
        return float(protocol_of(table["protocol"]).total(settings) * settings.duration)

    def run_table(
        self,
        policy: pathlib.Path,
        table: Table,
        *,
        seed: int,
        workers: int,
        folder: pathlib.Path,
        on_episode: Callable[[], None],
    ) -> dict[str, Any]:
        """Run a table with a policy; arguments as in `Services`."""
        protocol = protocol_of(table["protocol"])
        spec = ControllerSpec("learned", str(policy))
        store = ResultStore(folder) if protocol.stores_episodes else None
        count = 0

        def on_row(_: object) -> None:
            nonlocal count
            count += 1
            if store is None or count > store.restored:
                on_episode()

        with Execution(workers if protocol.stores_episodes else 1, store=store) as execution:
            settings = dataclasses.replace(settings_of(table, seed), execution=execution)
            settings = protocol.for_training(settings, spec.training)
            result = protocol.run(spec.build, settings, on_row)
        return finite_json(dataclasses.asdict(result))

    def executed(
        self, policy: pathlib.Path, commands: list[dict[str, Any]], settings: CalibrationSettings, workers: int
    ) -> list[dict[str, float]]:
        """Return what a policy executes under some commands; arguments as in `Services`."""
        plans = [EpisodePlan(_command(values)) for values in commands]
        with Execution(workers) as execution:
            episodes = EpisodeSettings(
                seed=settings.seed,
                duration=settings.duration,
                conditions=Conditions(),
                execution=execution,
            )
            rows = run_episodes(ControllerSpec("learned", str(policy)).build, plans, _judge, episodes)
        return [row.means for row in rows]


def _command(values: Mapping[str, Any]) -> Command:
    command = default_command(Gait.parse(values["gait"]))
    return dataclasses.replace(command, **{name: float(values[name]) for name in COMMAND_NAMES if name in values})


def settings_of(table: Table, seed: int) -> Any:  # noqa: ANN401  each protocol has its own type
    """Return the settings of a protocol from a table: its protocol, its gait, its own settings and conditions.

    Args:
        table: values by name.
        seed: seed of the episodes.

    Raises:
        UnknownNameError: if the protocol, the gait or a setting does not exist.
        ConfigError: if a value is out of range or of the wrong type.
    """
    name = str(table.get("protocol"))
    protocol = protocol_of(name)
    own, around = _fields(protocol.settings), _fields(Conditions)
    around = {key: kind for key, kind in around.items() if key not in protocol.fixed}
    valid = {key: kind for key, kind in own.items() if key not in _OWN} | around
    given = {key: value for key, value in table.items() if key != "protocol"}
    for key, value in given.items():
        if key not in valid:
            raise UnknownNameError(f"setting of the {name} protocol", key, valid)
        _check_type(key, value, valid[key])
    both_legs = given.get("gait") == BOTH_LEGS
    if "gait" in given:
        gait = Gait.HOPPING_LEFT if both_legs else Gait.parse(given["gait"])
        given |= {"gait": gait, "both_legs": both_legs}
    conditions = Conditions(**{key: value for key, value in given.items() if key in around and key not in own})
    return protocol.settings(
        **{key: value for key, value in given.items() if key in own}, seed=seed, conditions=conditions
    )


def _fields(settings: type[Any]) -> dict[str, Any]:
    hints = typing.get_type_hints(settings)
    return {field.name: hints[field.name] for field in dataclasses.fields(settings)}


def _check_type(name: str, value: object, kind: Any) -> None:  # noqa: ANN401  a type
    kinds = {part for part in (kind, *typing.get_args(kind)) if isinstance(part, type)}
    if name == "gait" or (float in kinds and type(value) in (int, float)) or type(value) in kinds:
        return
    words = " or ".join(sorted(part.__name__ for part in kinds))
    raise ConfigError(f"{name} is {value!r}; give a value of type {words}")
