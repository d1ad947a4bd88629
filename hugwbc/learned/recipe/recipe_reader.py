"""Reads the parts of a recipe file; a mistake is noted with its line, and the rest is read all the same."""

import dataclasses
import math
import pathlib
from collections.abc import Callable, Iterator, Mapping
from typing import Any, TypeVar

import yaml

from hugwbc.errors import HugwbcError, RecipeError, UnknownNameError
from hugwbc.learned.recipe import dotted
from hugwbc.learned.recipe.conditions_on_figures import Condition
from hugwbc.learned.recipe.recipe_records import KINDS, MeasureSettings, Recipe, Stage, input_names
from hugwbc.learned.recipe.stage_gates import ACTIONS, Gate, Times
from hugwbc.learned.recipe.stage_schedules import SHAPES, StageSchedule
from hugwbc.robot import model_dir
from hugwbc.yaml_file import YamlReader

ALL = "all"
Table = Mapping[str, Any]
Pairs = list[tuple[str, yaml.Node, yaml.Node]]  # key, its node, the value's node
Made = TypeVar("Made")


def recipe_folder() -> pathlib.Path:
    """Return the folder of the shipped recipes."""
    return model_dir() / "recipes"


def shipped_recipes() -> list[str]:
    """Return the names of the shipped recipes."""
    return sorted(path.stem for path in recipe_folder().glob("*.yaml"))


@dataclasses.dataclass
class Draft:
    """A recipe while it is read.

    Attributes:
        fields: fields of the recipe besides its stages.
        stages: the stages by name.
        nodes: where a stage, or a stage's entry, stands in a file: reader and node by "stage" or "stage/entry".
        profiles: differences by name of the profile.
        reader_of_profile: the reader of the file in which a profile stands.
    """

    fields: dict[str, Any] = dataclasses.field(default_factory=dict)
    stages: dict[str, Stage] = dataclasses.field(default_factory=dict)
    nodes: dict[str, tuple["RecipeReader", yaml.Node]] = dataclasses.field(default_factory=dict)
    profiles: dict[str, yaml.Node] = dataclasses.field(default_factory=dict)
    reader_of_profile: dict[str, "RecipeReader"] = dataclasses.field(default_factory=dict)

    def recipe(self) -> Recipe:
        """Return the finished recipe."""
        return Recipe(stages=tuple(self.stages.values()), **self.fields)


class RecipeReader(YamlReader):
    """Reads the parts of a recipe; a mistake is noted and its part left out, so that the next ones are found too."""

    def __init__(self, path: pathlib.Path, mistakes: list[str]) -> None:
        super().__init__(path, RecipeError)
        self.mistakes = mistakes

    def attempt(self, read: Callable[[], Made]) -> Made | None:
        """Return what a function reads, or note its mistake and return None."""
        try:
            return read()
        except HugwbcError as error:
            self.mistakes.append(str(error))
            return None

    def note(self, node: yaml.Node, message: object) -> None:
        """Note a mistake at a node."""
        self.attempt(lambda: self.fail(node, message))

    def pairs(self, node: yaml.Node, kind: str) -> Pairs:
        """Return the entries of a mapping; repeated and unreadable keys are noted."""
        if not isinstance(node, yaml.MappingNode):
            self.note(node, f"expected a mapping of {kind}, such as 'name: value'")
            return []
        found: dict[str, tuple[yaml.Node, yaml.Node]] = {}
        for key, value in node.value:
            if not isinstance(key, yaml.ScalarNode):
                self.note(key, f"expected a name in {kind}")
            elif key.value in found:
                self.note(key, f"'{key.value}' is given twice in {kind}; keep one")
            else:
                found[key.value] = (key, value)
        return [(name, key, value) for name, (key, value) in found.items()]

    def parent(self, node: yaml.Node) -> pathlib.Path:
        """Return the path of the parent recipe: a file beside this one, or a shipped recipe."""
        name = self.text(node)
        beside = self.path.parent / f"{name}.yaml"
        if beside.is_file() and beside.resolve() != self.path.resolve():
            return beside
        names = sorted({path.stem for path in self.path.parent.glob("*.yaml")} - {self.path.stem})
        if recipe_folder().resolve() != self.path.parent.resolve() and name in shipped_recipes():
            return recipe_folder() / f"{name}.yaml"
        self.fail(node, UnknownNameError("recipe", name, dict.fromkeys([*names, *shipped_recipes()])))

    def top(self, draft: Draft, values: Mapping[str, yaml.Node]) -> None:
        """Read the fields of the recipe besides its stages."""
        readers: dict[str, Callable[[yaml.Node], Any]] = {
            "about": self.text,
            "seed": self.integer,
            "measure": self.measure,
            "rates": self.rates,
        }
        for key, read in readers.items():
            if key in values:
                value = self.attempt(lambda key=key, read=read: read(values[key]))
                if value is not None:
                    draft.fields[key] = value
        if "seed" in values and "seed" in draft.fields:
            seed = draft.fields.pop("seed")
            if self.attempt(lambda: self.checked(values["seed"], Recipe, "", (), seed=seed)) is not None:
                draft.fields["seed"] = seed

    def measure(self, node: yaml.Node) -> MeasureSettings:
        """Read the settings of the measurements."""
        types = dotted.setting_types(MeasureSettings)
        values = {key: self.setting(key, at, value, types) for key, at, value in self.pairs(node, "measure")}
        return self.checked(node, MeasureSettings, **values)

    def rates(self, node: yaml.Node) -> dict[str, float]:
        """Read recorded speeds by kind of stage."""
        found = {}
        for kind, at, value in self.pairs(node, "rates"):
            if kind not in KINDS:
                self.fail(at, UnknownNameError("kind of stage", kind, KINDS))
            found[kind] = self.number(value)
            if not 0.0 < found[kind] < math.inf:
                self.fail(value, f"{kind}: {found[kind]:g} is not a speed above 0")
        return found

    def setting(self, name: str, at: yaml.Node, value: yaml.Node, types: Mapping[str, Any]) -> Any:  # noqa: ANN401
        """Return the value of a setting."""
        if name not in types:
            self.fail(at, dotted.unknown_setting(name, types))
        return dotted.read_value(self, value, types[name])

    # Stages ---------------------------------------------------------------------------------------------------------

    def stages(self, draft: Draft, node: yaml.Node, shared: Pairs) -> None:
        """Read the stages, and settings that all of them share."""
        used: set[str] = set()
        for name, at, value in self.pairs(node, "stages"):
            if not name.replace("-", "").replace("_", "").isalnum():
                self.note(at, f"'{name}' cannot be a stage's name; use letters, digits, - and _")
                continue
            stage = self.attempt(lambda name=name, value=value: self.stage(draft, name, value, shared, used))
            if stage is not None:
                draft.stages[name] = stage
                draft.nodes[name] = (self, at)
        known = {name for kind in KINDS.values() for name in dotted.setting_types(kind.settings)}
        for name, at, _ in shared:
            if name not in known:
                self.note(at, dotted.unknown_setting(name, sorted(known)))
            elif name not in used:
                self.note(at, f"no stage of this recipe has the setting '{name}'; leave it out")

    def stage(self, draft: Draft, name: str, node: yaml.Node, shared: Pairs, used: set[str]) -> Stage:
        """Read one stage."""
        entries = {key: (at, value) for key, at, value in self.pairs(node, f"stage {name}")}
        if "kind" not in entries:
            self.fail(node, f"stage {name} has no kind; valid: {', '.join(KINDS)}")
        kind = self.text(entries["kind"][1])
        if kind not in KINDS:
            self.fail(entries["kind"][1], UnknownNameError("kind of stage", kind, KINDS))
        stage = Stage(name, kind)
        types = dotted.setting_types(KINDS[kind].settings)
        for key, at, value in shared:
            if key in types:
                used.add(key)
                stage = self._with_setting(draft, stage, key, at, value)
        valid = [field.name for field in dataclasses.fields(Stage) if field.name != "name"]
        for key, (at, value) in entries.items():
            if key not in valid:
                close = f"; the setting '{key}' belongs under settings" if key in types else ""
                self.note(at, f"{UnknownNameError('stage field', key, valid)}{close}")
                continue
            draft.nodes[f"{name}/{key}"] = (self, value)
            stage = self._with_field_or_not(draft, stage, key, value)
        return stage

    def _with_field_or_not(self, draft: Draft, stage: Stage, key: str, node: yaml.Node) -> Stage:
        """Return the stage with a field, or, if that has mistakes, as it is."""
        changed = self.attempt(lambda: self._with_field(draft, stage, key, node))
        return stage if changed is None else changed

    def _with_field(self, draft: Draft, stage: Stage, key: str, node: yaml.Node) -> Stage:
        trains = stage.kind == "train"
        if key in ("gates", "schedules", "score", "keep", "if_given_up") and not trains:
            self.fail(node, f"'{key}' belongs to stages of kind train; {stage.name} is of kind {stage.kind}")
        if key == "kind":
            return stage
        if key in ("about", "score"):
            return dataclasses.replace(stage, **{key: self.text(node)})
        if key == "every":
            if KINDS[stage.kind].work is None:
                self.fail(node, f"'every' belongs to stages that take steps or labels; {stage.name} takes none")
            every = self.number(node)
            if not 0.0 < every < math.inf:
                self.fail(node, f"every is {every:g}; give a number of steps or labels above 0")
            return dataclasses.replace(stage, every=every)
        if key in ("keep", "if_given_up"):
            choices = {"keep": ("best", "last"), "if_given_up": ("fail", "skip", "best")}[key]
            return dataclasses.replace(stage, **{key: self.one_of(node, key, choices)})
        if key == "inputs":
            return dataclasses.replace(stage, inputs=dict(self._inputs(stage, node)))
        if key == "tables":
            return dataclasses.replace(stage, tables=tuple(self._tables(draft, stage, node)))
        if key == "gates":
            entries = [] if _is_empty_list(node) else self.nodes(node)
            gates = [self.attempt(lambda one=one: self._gate(stage, one)) for one in entries]
            return dataclasses.replace(stage, gates=tuple(gate for gate in gates if gate is not None))
        for name, at, value in self.pairs(node, key):
            if key == "settings":
                stage = self._with_setting(draft, stage, name, at, value)
            else:
                stage = self._with_schedule(draft, stage, name, at, value)
        return stage

    def _with_schedule(self, draft: Draft, stage: Stage, name: str, at: yaml.Node, value: yaml.Node) -> Stage:
        schedule = self.attempt(lambda: self._schedule(stage, name, at, value))
        if schedule is None:
            return stage
        draft.nodes[f"{stage.name}/{name}"] = (self, at)
        return dataclasses.replace(stage, schedules={**stage.schedules, name: schedule})

    def _with_setting(self, draft: Draft, stage: Stage, name: str, at: yaml.Node, value: yaml.Node) -> Stage:
        """Return the stage with another setting; a constant replaces a schedule of the same name."""
        read = self.attempt(lambda: (self._value(stage, name, at, value),))
        if read is None:
            return stage
        draft.nodes[f"{stage.name}/{name}"] = (self, at)
        schedules = {key: schedule for key, schedule in stage.schedules.items() if key != name}
        return dataclasses.replace(stage, settings={**stage.settings, name: read[0]}, schedules=schedules)

    def _value(self, stage: Stage, name: str, at: yaml.Node, value: yaml.Node) -> Any:  # noqa: ANN401
        kind = KINDS[stage.kind]
        if name in kind.own:
            self.fail(at, f"'{name}' is set by the run of the recipe; leave it out")
        types = dotted.setting_types(kind.settings)
        if name in types and name in input_names(stage.kind):
            self.fail(at, f"'{name}' is a file; name the stage that writes it under inputs: {{{name}: STAGE}}")
        return self.setting(name, at, value, types)

    def _inputs(self, stage: Stage, node: yaml.Node) -> Iterator[tuple[str, str]]:
        valid = input_names(stage.kind)
        for name, at, value in self.pairs(node, "inputs"):
            if name not in valid:
                self.note(at, UnknownNameError(f"input of a stage of kind {stage.kind}", name, valid))
                continue
            source = self.attempt(lambda value=value: self.text(value))
            if source is not None:
                yield name, source

    def _tables(self, draft: Draft, stage: Stage, node: yaml.Node) -> Iterator[Table]:
        if stage.kind != "evaluate":
            self.fail(node, f"'tables' belongs to stages of kind evaluate; {stage.name} is of kind {stage.kind}")
        for index, one in enumerate(self.nodes(node)):
            table = {key: _plain(self, value) for key, _, value in self.pairs(one, "table")}
            if "protocol" not in table:
                self.note(one, "the table names no protocol; give 'protocol: single-command'")
            draft.nodes[f"{stage.name}/table {index}"] = (self, one)
            yield table

    def _gate(self, stage: Stage, node: yaml.Node) -> Gate:
        values = self.fields(
            node,
            "gate",
            {
                "do": lambda r, n: r.text(n),
                "when": lambda r, n: r.conditions(n),
                "after": lambda r, n: r.number(n),
                "times": lambda r, n: r.integer(n),
                "at_most": lambda r, n: r.integer(n),
                "change": lambda r, n: dict(r.gate_changes(stage, n)),
            },
            required=("do", "when"),
        )
        if values["do"] not in ACTIONS:
            self.fail(node, UnknownNameError("action of a gate", values["do"], ACTIONS))
        return self.checked(node, Gate, **values)

    def conditions(self, node: yaml.Node) -> tuple[Condition, ...]:
        """Read conditions by figure."""
        found = [
            self.checked(value, Condition.parse, figure, self.text(value))
            for figure, _, value in self.pairs(node, "conditions, 'figure: below 0.02'")
        ]
        if not found:
            self.fail(node, "expected one condition or more, such as {evaluation/falls: below 0.02}")
        return tuple(found)

    def gate_changes(self, stage: Stage, node: yaml.Node) -> Iterator[tuple[str, Any]]:
        """Read the settings that a gate changes, to a value or, as 'times 0.5', by a factor."""
        for name, at, value in self.pairs(node, "changes"):
            text = value.value if isinstance(value, yaml.ScalarNode) else ""
            if text.startswith("times "):
                factor = float(text.removeprefix("times ")) if _is_number(text.removeprefix("times ")) else math.nan
                types = dotted.setting_types(KINDS[stage.kind].settings)
                if name not in types:
                    self.fail(at, dotted.unknown_setting(name, types))
                if not 0.0 < factor < math.inf:
                    self.fail(value, f"'{text}' is not a factor; write times 0.5")
                yield name, Times(factor)
            else:
                yield name, self._value(stage, name, at, value)

    def _schedule(self, stage: Stage, name: str, at: yaml.Node, node: yaml.Node) -> StageSchedule:
        entries = {key: value for key, _, value in self.pairs(node, "schedule")}
        shapes = [key for key in entries if key in SHAPES]
        if len(shapes) != 1:
            self.fail(node, f"a schedule has one of {', '.join(SHAPES)}, such as {{linear: [0.3, 0.1]}}")
        shape, rest = shapes[0], {key: value for key, value in entries.items() if key not in SHAPES}
        valid = {"gated": ("when", "back_when"), "steps": ()}.get(shape, ("from", "to"))
        for key in rest:
            if key not in valid:
                self.fail(rest[key], UnknownNameError(f"field of a schedule of shape {shape}", key, valid))
        fields: dict[str, Any] = {}
        if shape == "steps":
            steps = self.pairs(entries[shape], "steps, progress: value")
            fields["places"] = tuple(self.number(key) for _, key, _ in steps)
            fields["values"] = tuple(self._value(stage, name, at, value) for _, _, value in steps)
        else:
            fields["values"] = tuple(self._value(stage, name, at, one) for one in self.nodes(entries[shape]))
            if shape != "gated":
                fields["places"] = tuple(
                    self.number(rest[key]) if key in rest else default for key, default in (("from", 0.0), ("to", 1.0))
                )
        for key in ("when", "back_when"):
            if key in rest:
                fields[key] = self.conditions(rest[key])
        return self.checked(node, StageSchedule, shape, **fields)

    # Differences ----------------------------------------------------------------------------------------------------

    def without(self, draft: Draft, values: Mapping[str, yaml.Node]) -> None:
        """Leave stages out; stages that took them as inputs go without these inputs."""
        for node in self.nodes(values["without"]) if "without" in values else []:
            name = self.attempt(lambda node=node: self.text(node))
            if name is None:
                continue
            if name not in draft.stages:
                self.note(node, UnknownNameError("stage", name, draft.stages))
                continue
            del draft.stages[name]
            for other, stage in draft.stages.items():
                inputs = {key: source for key, source in stage.inputs.items() if source.partition("/")[0] != name}
                draft.stages[other] = dataclasses.replace(stage, inputs=inputs)

    def change(self, draft: Draft, node: yaml.Node) -> None:
        """Apply differences: to a stage, a kind of stage, all, or the measurements."""
        for target, at, value in self.pairs(node, "changes by stage"):
            if target == "measure":
                measure = self.attempt(lambda value=value: self.measure(value))
                draft.fields |= {} if measure is None else {"measure": measure}
                continue
            chosen = [s for s in draft.stages.values() if target in (s.name, s.kind, ALL)]
            if not chosen and target not in KINDS:  # a recipe may leave out all stages of a kind
                self.note(at, UnknownNameError("stage", target, [*draft.stages, *KINDS, "measure", ALL]))
                continue
            for name, key, setting in self.pairs(value, f"changes of {target}") if chosen else []:
                takers = [stage for stage in chosen if _takes(stage, name)]
                if not takers:
                    valid = [n for stage in chosen for n in dotted.setting_types(KINDS[stage.kind].settings)]
                    fields = ("every", "gates", "inputs", "tables", "keep", "if_given_up")
                    self.note(key, dotted.unknown_setting(name, dict.fromkeys([*valid, *fields])))
                for stage in takers:
                    draft.stages[stage.name] = self._changed(draft, draft.stages[stage.name], name, key, setting)

    def _changed(self, draft: Draft, stage: Stage, name: str, at: yaml.Node, value: yaml.Node) -> Stage:
        if name in ("every", "gates", "inputs", "tables", "keep", "if_given_up"):
            draft.nodes[f"{stage.name}/{name}"] = (self, value)
            return self._with_field_or_not(draft, stage, name, value)
        if stage.kind == "evaluate" and name not in dotted.setting_types(KINDS[stage.kind].settings):
            plain = _plain(self, value)
            return dataclasses.replace(stage, tables=tuple({**table, name: plain} for table in stage.tables))
        return self._with_setting(draft, stage, name, at, value)

    def budget(self, draft: Draft, node: yaml.Node) -> None:
        """Multiply the steps and labels of all stages by a factor."""
        factor = self.attempt(lambda: self.number(node))
        if factor is None:
            return
        if not 0.0 < factor <= 100.0:
            self.note(node, f"budget is {factor:g}; give a factor on steps and labels, above 0, up to 100")
            return
        for name, stage in draft.stages.items():
            work = KINDS[stage.kind].work
            if work is not None:
                every = None if stage.every is None else stage.every * factor
                settings = {**stage.settings, work: stage.work * factor}
                draft.stages[name] = dataclasses.replace(stage, settings=settings, every=every)


def _takes(stage: Stage, name: str) -> bool:
    if name in ("every", "gates", "inputs", "tables", "keep", "if_given_up"):
        return True
    in_tables = stage.kind == "evaluate" and name in ("episodes", "duration", "gait")
    return name in dotted.setting_types(KINDS[stage.kind].settings) or in_tables


def _plain(reader: YamlReader, node: yaml.Node) -> Any:  # noqa: ANN401  text, a number or a truth value
    text = reader.text(node)
    if text in ("true", "false"):
        return text == "true"
    if not _is_number(text):
        return text
    number = float(text)
    return int(number) if number == number // 1 and "." not in text else number


def _is_empty_list(node: yaml.Node) -> bool:
    return isinstance(node, yaml.SequenceNode) and not node.value


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False
