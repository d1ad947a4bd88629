"""What a recipe would cost: steps, labels and core-hours of each stage, from recorded or measured speeds."""

import dataclasses
import tempfile
from collections.abc import Mapping
from pathlib import Path

from hugwbc.learned.config import TrainConfig
from hugwbc.learned.imitation import Imitator
from hugwbc.learned.recipe.closing_stages import knots_of
from hugwbc.learned.recipe.ledger import cpu_seconds
from hugwbc.learned.recipe.recipe_records import CalibrationSettings, Recipe, Stage
from hugwbc.learned.recipe.stage_work import Services
from hugwbc.learned.rl.trainer import Trainer
from hugwbc.robot import load_robot

# Units per CPU second where neither the recipe nor a measurement says otherwise: steps of a training (1,024 robots; the
# training of the shipped policy), labels of the QP and of policies, simulated seconds of an evaluation.
USUAL_RATES: Mapping[str, float] = {
    "train": 4500.0,
    "imitate": 250.0,
    "distil": 4000.0,
    "evaluate": 1.4,
    "calibrate": 1.4,
}
_EXPORT = 10.0  # [s]
_CONTROL_STEPS = 50.0  # per second


@dataclasses.dataclass(frozen=True)
class StageCost:
    """What a stage would cost if no gate acts.

    Attributes:
        stage, kind: name and kind.
        steps: steps of training.
        measured_steps: steps of the measurements within it.
        labels: labels of teachers.
        simulated: length of all episodes of an evaluation or calibration [s].
        cpu_seconds: processor time [s].
        source: where the speed comes from.
        most_steps: steps if every gate that goes back acts as often as it may, each time at the very end.
    """

    stage: str
    kind: str
    steps: float = 0.0
    measured_steps: float = 0.0
    labels: float = 0.0
    simulated: float = 0.0
    cpu_seconds: float = 0.0
    source: str = ""
    most_steps: float = 0.0


def forecast(recipe: Recipe, services: Services, measured: Mapping[str, float] | None = None) -> list[StageCost]:
    """Return what each stage would cost.

    Args:
        recipe: the recipe.
        services: knows the length of evaluations.
        measured: measured speeds by stage name or kind; without them, the recipe's recorded ones.
    """
    return [_cost(recipe, stage, services, measured or {}) for stage in recipe.stages]


def _cost(recipe: Recipe, stage: Stage, services: Services, measured: Mapping[str, float]) -> StageCost:
    if stage.kind == "export":
        return StageCost(stage.name, stage.kind, cpu_seconds=_EXPORT, source="usual")
    rate, source = _rate(recipe, stage, measured)
    cost = StageCost(stage.name, stage.kind, source=source)
    if stage.kind == "train":
        every = recipe.measure.robots * recipe.measure.seconds * _CONTROL_STEPS * stage.segments
        # A measurement only simulates, which is half of the work of a training.
        seconds = (stage.work + 0.5 * every) / rate
        returns = sum(gate.at_most for gate in stage.gates if gate.do == "back")
        most = stage.work * (1.0 + returns)
        return dataclasses.replace(cost, steps=stage.work, measured_steps=every, cpu_seconds=seconds, most_steps=most)
    if stage.kind in ("imitate", "distil"):
        return dataclasses.replace(cost, labels=stage.work, cpu_seconds=stage.work / rate)
    if stage.kind == "calibrate":
        settings: CalibrationSettings = stage.config()
        episodes = sum(len(pairs) for of_gait in knots_of(settings).values() for pairs in of_gait.values())
        simulated = episodes * settings.duration * (settings.rounds + 1)
    else:
        simulated = sum(services.simulated_seconds(table) for table in stage.tables)
    return dataclasses.replace(cost, simulated=simulated, cpu_seconds=simulated / rate)


def _rate(recipe: Recipe, stage: Stage, measured: Mapping[str, float]) -> tuple[float, str]:
    for source, rates in (("measured", measured), ("recipe", recipe.rates), ("usual", USUAL_RATES)):
        for key in (stage.name, stage.kind):
            if key in rates:
                return rates[key], source
    raise AssertionError(f"no rate for {stage.kind}")


def measure_rates(recipe: Recipe, services: Services, iterations: int = 2) -> dict[str, float]:
    """Measure the speed of the first training and of the first imitation; return units per CPU second by kind.

    Args:
        recipe: the recipe.
        services: makes the teachers.
        iterations: iterations of the training that are measured; one more warms up.
    """
    rates: dict[str, float] = {}
    for stage in recipe.stages:
        if stage.kind in rates or stage.kind not in ("train", "imitate"):
            continue
        with tempfile.TemporaryDirectory() as folder:
            if stage.kind == "train":
                rates["train"] = _training_rate(stage, Path(folder), iterations)
            else:
                config = stage.config(own={"out": Path(folder)})
                imitator = Imitator(config, services.teacher(load_robot(config.env.robot)))
                imitator.collect()
                before = cpu_seconds()
                for _ in range(10):
                    imitator.collect()
                rates["imitate"] = 10 * config.env.count / max(cpu_seconds() - before, 1e-6)
    return rates


def _training_rate(stage: Stage, folder: Path, iterations: int) -> float:
    # Without what earlier stages would have written; it hardly changes the speed.
    alone = dataclasses.replace(stage, inputs={})
    config: TrainConfig = alone.config(own={"out": folder, "evaluation_interval": 0})
    trainer = Trainer(config)
    trainer.iterate()
    before, steps = cpu_seconds(), trainer.steps
    for _ in range(iterations):
        trainer.iterate()
    return (trainer.steps - steps) / max(cpu_seconds() - before, 1e-6)
