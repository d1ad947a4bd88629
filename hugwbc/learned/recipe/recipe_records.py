"""What a recipe says, as frozen records: stages with inputs, settings, schedules and gates."""

import dataclasses
import hashlib
import json
import pathlib
from collections.abc import Collection, Mapping
from typing import Any, Literal

from hugwbc.errors import ConfigError
from hugwbc.learned.config import CALIBRATED_COMMANDS, DistillationConfig, ImitationConfig, Schedule, TrainConfig
from hugwbc.learned.config.checks import require
from hugwbc.learned.config.schedules import SCHEDULED
from hugwbc.learned.recipe.dotted import flat, setting_types, with_settings
from hugwbc.learned.recipe.stage_gates import Gate, Times
from hugwbc.learned.recipe.stage_schedules import StageSchedule
from hugwbc.seeds import REPORT_SEED, REPORT_SEEDS, SELECTION_SEED, SELECTION_SEEDS, TRAINING_SEED, TRAINING_SEEDS

POLICY, SNAPSHOT, STARTS, FIGURES = "policy.safetensors", "snapshot.safetensors", "starts.safetensors", "figures.json"
LABELS = "labels.safetensors"
# Groups that the trainer reads anew in every iteration. Not env.command: shares of the gaits are valid together only,
# and the trainer changes one after the other.
_SMOOTH = frozenset(SCHEDULED) - {"env.command"}
PLACEHOLDER = pathlib.Path("from-an-earlier-stage")  # stands for an input while settings are only checked


@dataclasses.dataclass(frozen=True)
class CalibrationSettings:
    """Calibration of a policy by feed-forward: curves of what to ask it for, measured in the arena."""

    commands: tuple[str, ...] = ("v_x", "v_y", "omega", "h", "p", "l")
    """Commands to calibrate."""
    gaits: tuple[str, ...] = ("standing", "walking", "jumping", "hopping_left", "hopping_right")
    """Gaits to calibrate."""
    knots: int = 5
    """Values of each command at which a curve is measured, spread evenly over its range."""
    rounds: int = 3
    """How often the curves are measured and corrected."""
    rate: float = 0.7
    """Fraction of the measured error that is corrected in a round."""
    duration: float = 6.0
    """Length of an episode [s]; the first second does not count."""
    seed: int = SELECTION_SEED
    """Seed of the episodes: one of selection."""

    def __post_init__(self) -> None:
        """Check the ranges."""
        for name in self.commands:
            require(name in CALIBRATED_COMMANDS, "commands", name, ", ".join(CALIBRATED_COMMANDS))
        require(2 <= self.knots <= 25, "knots", self.knots, "2 to 25")
        require(1 <= self.rounds <= 20, "rounds", self.rounds, "1 to 20")
        require(0.0 < self.rate <= 1.0, "rate", self.rate, "above 0, up to 1")
        require(1.5 <= self.duration <= 60.0, "duration", self.duration, "1.5 to 60 s")
        require(self.seed in SELECTION_SEEDS, "seed", self.seed, "a seed of selection, 0 to 999")


@dataclasses.dataclass(frozen=True)
class EvaluationSettings:
    """The evaluation at the end, at a seed on which nothing was chosen."""

    seed: int = REPORT_SEED
    """Seed of all tables: one of report."""
    workers: int = 1
    """Processes that share the episodes."""

    def __post_init__(self) -> None:
        """Check the ranges."""
        require(self.seed in REPORT_SEEDS, "seed", self.seed, "a seed of report, 1000 to 1999")
        require(1 <= self.workers <= 512, "workers", self.workers, "1 to 512")


@dataclasses.dataclass(frozen=True)
class ExportSettings:
    """The folder that can be shipped: policy, snapshot, figures, ancestry."""

    onnx: bool = False
    """Whether to write policy.onnx as well (extra [export])."""


@dataclasses.dataclass(frozen=True)
class MeasureSettings:
    """The measurements within a training, on which its gates and its choice of a checkpoint rest."""

    robots: int = 128
    """Robots of a measurement."""
    seconds: float = 5.0
    """Length of their episodes [s]."""

    def __post_init__(self) -> None:
        """Check the ranges."""
        require(self.robots > 0, "robots", self.robots, "a positive integer")
        require(0.0 < self.seconds <= 600.0, "seconds", self.seconds, "above 0, up to 600 s")


@dataclasses.dataclass(frozen=True)
class Kind:
    """A kind of stage.

    Attributes:
        settings: dataclass of its settings.
        inputs: inputs that it takes; those of its settings that are paths can be inputs as well.
        required: inputs that it cannot do without.
        outputs: files that it writes.
        own: settings that the run of a recipe sets by itself.
        work: setting that says how much work the stage is: steps or labels.
    """

    settings: type[Any]
    outputs: tuple[str, ...]
    inputs: tuple[str, ...] = ()
    required: tuple[str, ...] = ()
    own: tuple[str, ...] = ()
    work: str | None = None


KINDS: Mapping[str, Kind] = {
    "imitate": Kind(ImitationConfig, (POLICY, SNAPSHOT, STARTS, LABELS), own=("out", "keep_labels"), work="samples"),
    "train": Kind(
        TrainConfig,
        (POLICY, SNAPSHOT),
        own=("out", "resume", "hours", "evaluation_interval", "schedules"),
        work="steps",
    ),
    "distil": Kind(DistillationConfig, (POLICY, SNAPSHOT), required=("start_from",), own=("out",), work="samples"),
    "calibrate": Kind(CalibrationSettings, (POLICY, "calibration.json"), ("policy",), ("policy",)),
    "evaluate": Kind(EvaluationSettings, (FIGURES,), ("policy",), ("policy",)),
    "export": Kind(ExportSettings, (POLICY,), ("policy", "snapshot", "figures", "uncalibrated"), ("policy",)),
}
# Files of the inputs of these names.
TAKEN_BY_NAME = {"policy": POLICY, "snapshot": SNAPSHOT, "figures": FIGURES, "uncalibrated": FIGURES}


def path_settings(kind: str) -> list[str]:
    """Return the settings of a kind of stage that are paths of files, which other stages can provide."""
    types = setting_types(KINDS[kind].settings)
    paths = [name for name, found in types.items() if pathlib.Path in (found, *getattr(found, "__args__", ()))]
    return [name for name in paths if name not in KINDS[kind].own]


def input_names(kind: str) -> list[str]:
    """Return the names of the inputs that a kind of stage can take."""
    return [*KINDS[kind].inputs, *path_settings(kind)]


@dataclasses.dataclass(frozen=True)
class Stage:
    """A step of a recipe.

    Attributes:
        name: its name, unique in the recipe, and of its folder.
        kind: one of `KINDS`.
        about: what it is for, a sentence.
        inputs: stage that provides each input; "stage/file" for another file than the usual one.
        settings: values by dotted name; the others are at their defaults.
        schedules: values over the stage, of trainings only.
        gates: when a training goes on, back, or is given up.
        every: work, in steps or labels, between two measurements of a training, or two resting places of a stage that
            collects labels; None for a tenth of the stage.
        score: figure by which a training's best checkpoint is chosen; the lowest is best.
        keep: which checkpoint of a training goes on: the best or the last.
        if_given_up: what a given-up training leads to: fail ends the run, skip passes on what the stage started from,
            best goes on with its best checkpoint.
        tables: of an evaluation: protocol and its settings, one entry per table.
    """

    name: str
    kind: str
    about: str = ""
    inputs: Mapping[str, str] = dataclasses.field(default_factory=dict)
    settings: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    schedules: Mapping[str, StageSchedule] = dataclasses.field(default_factory=dict)
    gates: tuple[Gate, ...] = ()
    every: float | None = None
    score: str = "evaluation/score"
    keep: Literal["best", "last"] = "best"
    if_given_up: Literal["fail", "skip", "best"] = "fail"
    tables: tuple[Mapping[str, Any], ...] = ()

    @property
    def work(self) -> float:
        """Steps or labels of the stage; 0 for the other kinds."""
        name = KINDS[self.kind].work
        if name is None:
            return 0.0
        return float(self.settings.get(name, getattr(KINDS[self.kind].settings, name)))

    @property
    def segments(self) -> int:
        """Number of parts between two measurements or resting places."""
        return max(1, round(self.work / (self.every or max(self.work / 10.0, 1.0))))

    def end_of(self, segment: int) -> float:
        """Return the steps or labels of the stage at the end of a segment, counted from 0."""
        return self.work * (segment + 1) / self.segments

    def progress_of(self, segment: int) -> float:
        """Return the progress at which schedules are read in a segment: 0 in the first one, 1 in the last."""
        return segment / max(self.segments - 1, 1)

    def parents(self) -> list[str]:
        """Return the names of the stages that it takes inputs from, each once."""
        return list(dict.fromkeys(source.partition("/")[0] for source in self.inputs.values()))

    def smooth_schedules(self, begin: float, without: Collection[str] = ()) -> tuple[Schedule, ...]:
        """Return the ramps that a trainer can follow in every iteration; the others change from segment to segment.

        Args:
            begin: steps of the network before the stage.
            without: settings to leave out, since a gate has changed them.
        """
        found = []
        for name, schedule in self.schedules.items():
            scale: Literal["linear", "log"] | None
            scale = {"linear": "linear", "geometric": "log"}.get(schedule.shape)  # type: ignore[assignment]
            numbers = all(isinstance(value, int | float) for value in schedule.values)
            smooth = name in _SMOOTH or name.rpartition(".")[0] in _SMOOTH
            if scale and numbers and smooth and name not in without:
                steps = tuple(begin + place * self.work for place in schedule.places)
                found.append(Schedule(name, steps, tuple(map(float, schedule.values)), scale))
        return tuple(found)

    def resolved(self) -> dict[str, Any]:
        """Return all settings at the stage's begin by dotted name, defaults included, as JSON."""
        return json.loads(json.dumps(flat(self.config()), default=str))

    def config(
        self,
        progress: float = 0.0,
        *,
        levels: Mapping[str, int] | None = None,
        changes: Mapping[str, Any] | None = None,
        own: Mapping[str, Any] | None = None,
    ) -> Any:  # noqa: ANN401  the settings of the kind
        """Return the settings at some progress of the stage.

        Args:
            progress: fraction of the stage that is done.
            levels: levels of the gated schedules; 0 where one is missing.
            changes: settings that a gate has changed, to a value or by a factor.
            own: settings by dotted name that the run sets, such as paths.

        Raises:
            HugwbcError: if a setting does not exist or is out of range.
        """
        values = dict(self.settings)
        values |= {
            name: schedule.value(progress, (levels or {}).get(name, 0)) for name, schedule in self.schedules.items()
        }
        kind = KINDS[self.kind]
        types = setting_types(kind.settings)
        values = {name: _typed(value, types.get(name)) for name, value in values.items()}
        inputs = {name: PLACEHOLDER for name in self.inputs if name in types}
        base = kind.settings
        for name, change in (changes or {}).items():
            if isinstance(change, Times):
                value = values[name] if name in values else _default(kind, inputs, name)
                values[name] = _typed(_scaled(value, change.factor), types.get(name))
            else:
                values[name] = change
        return with_settings(_made(base, inputs | values), inputs | values | dict(own or {}))


def _made(settings: type[Any], values: Mapping[str, Any]) -> Any:  # noqa: ANN401
    """Return default settings; top-level values are given at once, since some defaults are refused without them."""
    top = {name: value for name, value in values.items() if "." not in name}
    known = {field.name for field in dataclasses.fields(settings)}
    try:
        return settings(**{name: value for name, value in top.items() if name in known})
    except ConfigError:
        if settings is not DistillationConfig:
            raise
        # The default environment draws gaits that may have no teacher; the recipe's own shares are checked afterwards.
        teachers = {name: PLACEHOLDER for name in ("standing", "walking", "jumping", "hopping") if name not in top}
        groups = {name: value for name, value in values.items() if "." in name}
        filled = with_settings(settings(**{**{k: v for k, v in top.items() if k in known}, **teachers}), groups)
        return dataclasses.replace(filled, **dict.fromkeys(teachers))


def _default(kind: Kind, inputs: Mapping[str, Any], name: str) -> Any:  # noqa: ANN401
    value = _made(kind.settings, inputs)
    for part in name.split("."):
        value = getattr(value, part)
    return value


def _scaled(value: Any, factor: float) -> Any:  # noqa: ANN401
    return tuple(one * factor for one in value) if isinstance(value, tuple) else value * factor


def _typed(value: Any, kind: Any) -> Any:  # noqa: ANN401
    """Round what a schedule gives to a setting that is a whole number."""
    return round(value) if kind is int and isinstance(value, float) else value


def usual_file(name: str, parent: Stage) -> str:
    """Return which file of a stage an input takes by its name: env.starts takes starts.safetensors.

    Args:
        name: name of the input.
        parent: the stage.
    """
    own = f"{name.rpartition('.')[2]}.safetensors"
    if name in TAKEN_BY_NAME:
        return TAKEN_BY_NAME[name]
    return own if own in KINDS[parent.kind].outputs else SNAPSHOT


@dataclasses.dataclass(frozen=True)
class Recipe:
    """A sequence of stages that makes a policy.

    Attributes:
        name: its name.
        about: what it makes, a sentence.
        seed: seed of its trainings; stages that do not set their own use this one.
        measure: settings of the measurements within trainings.
        stages: the stages, each after those that it takes inputs from.
        rates: recorded speed of each kind of stage in units of work per CPU second, for the plan.
        profile: name of the profile that was applied; empty for none.
    """

    name: str
    stages: tuple[Stage, ...]
    about: str = ""
    seed: int = TRAINING_SEED
    measure: MeasureSettings = MeasureSettings()
    rates: Mapping[str, float] = dataclasses.field(default_factory=dict)
    profile: str = ""

    def __post_init__(self) -> None:
        """Check the seed.

        Raises:
            ConfigError: if it is not one of training.
        """
        require(self.seed in TRAINING_SEEDS, "seed", self.seed, "a seed of training, 2000 to 2999")

    def stage(self, name: str) -> Stage:
        """Return the stage of a name."""
        return next(stage for stage in self.stages if stage.name == name)

    def as_dict(self) -> dict[str, Any]:
        """Return everything that the recipe says as JSON; two recipes that do the same have the same."""
        return json.loads(json.dumps(dataclasses.asdict(self), default=str))

    @property
    def digest(self) -> str:
        """Digest of what determines the result: texts and recorded rates are left out."""
        content = self.as_dict()
        for key in ("about", "rates"):
            del content[key]
        for stage in content["stages"]:
            del stage["about"]
        return json_digest(content)

    def stage_digest(self, name: str) -> str:
        """Return the digest of a stage and all that it rests on: it is the same as long as a redo would do the same."""
        stage = self.stage(name)
        own = json.loads(json.dumps(dataclasses.asdict(stage), default=str))
        del own["about"]
        measure = dataclasses.asdict(self.measure) if stage.kind == "train" else None
        parents = {parent: self.stage_digest(parent) for parent in stage.parents()}
        return json_digest({"stage": own, "seed": self.seed, "measure": measure, "parents": parents})


def json_digest(content: Any) -> str:  # noqa: ANN401  whatever JSON holds
    """Return 32 hexadecimal digits of the SHA-256 of JSON content, whatever the order of its keys."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:32]
