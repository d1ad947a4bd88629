"""Recipe files: YAML in, `Recipe` out; every mistake is reported with its line, all of them at once.

Nothing in a file is executed. A recipe can name another one as its parent and say what differs; a profile is such a
set of differences within a file.
"""

import dataclasses
import math
import os
import pathlib
from collections.abc import Callable, Iterator, Mapping
from typing import Any, TypeVar

import yaml

from hugwbc.errors import HugwbcError, RecipeError, UnknownNameError
from hugwbc.learned.recipe import dotted
from hugwbc.learned.recipe.conditions_on_figures import Condition
from hugwbc.learned.recipe.recipe_records import (
    KINDS,
    MeasureSettings,
    Recipe,
    Stage,
    input_names,
)
from hugwbc.learned.recipe.schedules import SHAPES, Schedule
from hugwbc.learned.recipe.stage_gates import ACTIONS, Gate, Times
from hugwbc.robot import model_dir
from hugwbc.yaml_file import YamlReader

ALL = "all"
HINT = "a recipe has a list of stages, as docs/how-to/make-a-policy-again.md says"
Table = Mapping[str, Any]
Pairs = list[tuple[str, yaml.Node, yaml.Node]]  # key, its node, the value's node
Made = TypeVar("Made")
_GRANDPARENTS = 5


def recipe_folder() -> pathlib.Path:
    """Return the folder of the shipped recipes."""
    return model_dir() / "recipes"


def shipped_recipes() -> list[str]:
    """Return the names of the shipped recipes."""
    return sorted(path.stem for path in recipe_folder().glob("*.yaml"))


def recipe_file(name_or_path: str | pathlib.Path) -> pathlib.Path:
    """Find a recipe, given the name of a shipped one or the path of a file.

    Raises:
        UnknownNameError: if it is neither.
    """
    path = pathlib.Path(name_or_path)
    shipped = recipe_folder() / f"{name_or_path}.yaml"
    for candidate in (path, shipped):
        if os.path.isfile(candidate):
            return candidate
    raise UnknownNameError("recipe", name_or_path, [*shipped_recipes(), "the path of a recipe file"])


def load_recipe(
    name_or_path: str | pathlib.Path,
    *,
    profile: str | None = None,
    check_table: Callable[[Table], None] = lambda table: None,
) -> Recipe:
    """Read a recipe and check all of it: names, units, ranges, schedules at every measurement, inputs.

    Args:
        name_or_path: name of a shipped recipe, or path of a file.
        profile: name of a profile in the file, or in its parent.
        check_table: raises a `HugwbcError` on a table of an evaluation that cannot be run.

    Raises:
        UnknownNameError: if there is no such recipe or profile.
        RecipeError: if the file has mistakes; the message has all of them, each with its line.
    """
    path = recipe_file(name_or_path)
    mistakes: list[str] = []
    draft = _read(path, mistakes, depth=0)
    if draft is not None and profile is not None:
        if profile not in draft.profiles:
            raise UnknownNameError("profile", profile, draft.profiles)
        draft.reader_of_profile[profile].change(draft, draft.profiles[profile])
        draft.fields["profile"] = profile
    if draft is not None and not mistakes:
        _check(draft, mistakes, check_table)
    if mistakes:
        mistakes = list(dict.fromkeys(mistakes))
        head = f"{len(mistakes)} mistakes in the recipe {path}:\n" if len(mistakes) > 1 else ""
        raise RecipeError(head + "\n".join(mistakes))
    assert draft is not None
    return draft.recipe()


@dataclasses.dataclass
class _Draft:
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
    nodes: dict[str, tuple["_Reader", yaml.Node]] = dataclasses.field(default_factory=dict)
    profiles: dict[str, yaml.Node] = dataclasses.field(default_factory=dict)
    reader_of_profile: dict[str, "_Reader"] = dataclasses.field(default_factory=dict)

    def recipe(self) -> Recipe:
        return Recipe(stages=tuple(self.stages.values()), **self.fields)


def _read(path: pathlib.Path, mistakes: list[str], depth: int) -> _Draft | None:
    reader = _Reader(path, mistakes)
    root = reader.attempt(lambda: reader.load("recipe", HINT))
    if root is None:
        return None
    pairs = {key: (at, value) for key, at, value in reader.pairs(root, "recipe")}
    valid = ("about", "parent", "seed", "measure", "rates", "settings", "stages", "without", "budget", "changes")
    for key, (at, _) in pairs.items():
        if key not in (*valid, "profiles"):
            reader.note(at, UnknownNameError("recipe field", key, (*valid, "profiles")))
    values = {key: value for key, (_, value) in pairs.items()}
    draft = _Draft()
    if "parent" in values:
        if depth >= _GRANDPARENTS:
            reader.note(values["parent"], "the recipe has more than five generations of parents; name its parent")
            return None
        parent = reader.attempt(lambda: reader.parent(values["parent"]))
        found = None if parent is None else _read(parent, mistakes, depth + 1)
        if found is None:
            return None
        draft = found
    draft.fields["name"] = path.stem
    reader.top(draft, values)
    if "stages" in values:
        shared = reader.pairs(values["settings"], "settings") if "settings" in values else []
        reader.stages(draft, values["stages"], shared)
    elif "parent" not in values:
        reader.note(root, f"the recipe has no stages and no parent; {HINT}")
    elif "settings" in values:
        reader.note(values["settings"], "'settings' belongs to a recipe with stages; use 'changes: {all: ...}'")
    reader.without(draft, values)
    if "changes" in values:
        reader.change(draft, values["changes"])
    if "budget" in values:
        reader.budget(draft, values["budget"])
    for name, _, node in reader.pairs(values["profiles"], "profiles") if "profiles" in values else []:
        draft.profiles[name], draft.reader_of_profile[name] = node, reader
    return draft


class _Reader(YamlReader):
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

    def top(self, draft: _Draft, values: Mapping[str, yaml.Node]) -> None:
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
            self.fail(at, UnknownNameError("setting", name, types))
        return dotted.read_value(self, value, types[name])

    # Stages ---------------------------------------------------------------------------------------------------------

    def stages(self, draft: _Draft, node: yaml.Node, shared: Pairs) -> None:
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
                self.note(at, UnknownNameError("setting", name, sorted(known)))
            elif name not in used:
                self.note(at, f"no stage of this recipe has the setting '{name}'; leave it out")

    def stage(self, draft: _Draft, name: str, node: yaml.Node, shared: Pairs, used: set[str]) -> Stage:
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
            changed = self.attempt(lambda key=key, value=value: self._with_field(draft, stage, key, value))
            stage = stage if changed is None else changed
        return stage

    def _with_field(self, draft: _Draft, stage: Stage, key: str, node: yaml.Node) -> Stage:
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
            if self.text(node) not in choices:
                self.fail(node, UnknownNameError(key, self.text(node), choices))
            return dataclasses.replace(stage, **{key: self.text(node)})
        if key == "inputs":
            return dataclasses.replace(stage, inputs=dict(self._inputs(stage, node)))
        if key == "tables":
            return dataclasses.replace(stage, tables=tuple(self._tables(draft, stage, node)))
        if key == "gates":
            gates = [self.attempt(lambda one=one: self._gate(stage, one)) for one in self.nodes(node)]
            return dataclasses.replace(stage, gates=tuple(gate for gate in gates if gate is not None))
        for name, at, value in self.pairs(node, key):
            if key == "settings":
                stage = self._with_setting(draft, stage, name, at, value)
            else:
                schedule = self.attempt(lambda name=name, at=at, value=value: self._schedule(stage, name, at, value))
                if schedule is not None:
                    draft.nodes[f"{stage.name}/{name}"] = (self, at)
                    stage = dataclasses.replace(stage, schedules={**stage.schedules, name: schedule})
        return stage

    def _with_setting(self, draft: _Draft, stage: Stage, name: str, at: yaml.Node, value: yaml.Node) -> Stage:
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

    def _tables(self, draft: _Draft, stage: Stage, node: yaml.Node) -> Iterator[Table]:
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
            for figure, _, value in self.pairs(node, "conditions, figure: '< number'")
        ]
        if not found:
            self.fail(node, "expected one condition or more, such as {evaluation/falls: < 0.02}")
        return tuple(found)

    def gate_changes(self, stage: Stage, node: yaml.Node) -> Iterator[tuple[str, Any]]:
        """Read the settings that a gate changes, to a value or, as 'times 0.5', by a factor."""
        for name, at, value in self.pairs(node, "changes"):
            text = value.value if isinstance(value, yaml.ScalarNode) else ""
            if text.startswith("times "):
                factor = float(text.removeprefix("times ")) if _is_number(text.removeprefix("times ")) else math.nan
                types = dotted.setting_types(KINDS[stage.kind].settings)
                if name not in types:
                    self.fail(at, UnknownNameError("setting", name, types))
                if not 0.0 < factor < math.inf:
                    self.fail(value, f"'{text}' is not a factor; write times 0.5")
                yield name, Times(factor)
            else:
                yield name, self._value(stage, name, at, value)

    def _schedule(self, stage: Stage, name: str, at: yaml.Node, node: yaml.Node) -> Schedule:
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
        return self.checked(node, Schedule, shape, **fields)

    # Differences ----------------------------------------------------------------------------------------------------

    def without(self, draft: _Draft, values: Mapping[str, yaml.Node]) -> None:
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

    def change(self, draft: _Draft, node: yaml.Node) -> None:
        """Apply differences: by stage, by kind of stage, or to all; settings by dotted name, and `every`."""
        for target, at, value in self.pairs(node, "changes by stage"):
            chosen = [s for s in draft.stages.values() if target in (s.name, s.kind, ALL)]
            if not chosen:
                self.note(at, UnknownNameError("stage", target, [*draft.stages, *KINDS, ALL]))
                continue
            for name, key, setting in self.pairs(value, f"changes of {target}"):
                takers = [stage for stage in chosen if _takes(stage, name)]
                if not takers:
                    valid = [n for stage in chosen for n in dotted.setting_types(KINDS[stage.kind].settings)]
                    fields = ("every", "gates", "inputs", "tables", "keep", "if_given_up")
                    self.note(key, UnknownNameError("setting", name, dict.fromkeys([*valid, *fields])))
                for stage in takers:
                    draft.stages[stage.name] = self._changed(draft, draft.stages[stage.name], name, key, setting)

    def _changed(self, draft: _Draft, stage: Stage, name: str, at: yaml.Node, value: yaml.Node) -> Stage:
        if name in ("every", "gates", "inputs", "tables", "keep", "if_given_up"):
            changed = self.attempt(lambda: self._with_field(draft, stage, name, value))
            draft.nodes[f"{stage.name}/{name}"] = (self, value)
            return stage if changed is None else changed
        if stage.kind == "evaluate" and name not in dotted.setting_types(KINDS[stage.kind].settings):
            plain = _plain(self, value)
            return dataclasses.replace(stage, tables=tuple({**table, name: plain} for table in stage.tables))
        return self._with_setting(draft, stage, name, at, value)

    def budget(self, draft: _Draft, node: yaml.Node) -> None:
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


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False


# Checks of the whole --------------------------------------------------------------------------------------------------


def _check(draft: _Draft, mistakes: list[str], check_table: Callable[[Table], None]) -> None:
    """Note what is wrong with stages as a whole: inputs, and settings at every measurement."""
    earlier: dict[str, Stage] = {}
    for name, stage in draft.stages.items():
        reader, node = draft.nodes[name]
        problems = [*_input_problems(stage, earlier, draft.stages), *_setting_problems(stage)]
        for entry, problem in problems:
            at_reader, at = draft.nodes.get(f"{name}/{entry}", (reader, node))
            at_reader.note(at, f"stage {name}: {problem}")
        if stage.kind == "evaluate" and not stage.tables:
            reader.note(node, f"stage {name} has no tables; give a list of protocols under tables")
        for index, table in enumerate(stage.tables):
            at_reader, at = draft.nodes.get(f"{name}/table {index}", (reader, node))
            at_reader.attempt(lambda r=at_reader, at=at, table=table: r.checked(at, check_table, table))
        if stage.if_given_up == "skip" and "start_from" not in stage.inputs:
            reader.note(node, f"stage {name} starts from nothing: if it is given up there is nothing to pass on; "
                              "use if_given_up: fail or best")  # fmt: skip
        earlier[name] = stage


def _input_problems(
    stage: Stage, earlier: Mapping[str, Stage], every: Mapping[str, Stage]
) -> Iterator[tuple[str, object]]:
    for name in KINDS[stage.kind].required:
        if name not in stage.inputs:
            yield "inputs", f"the input '{name}' is missing; give inputs: {{{name}: STAGE}}"
    for name, source in stage.inputs.items():
        parent, _, file = source.partition("/")
        if parent not in earlier:
            later = "comes later; move it before this one" if parent in every else None
            yield "inputs", f"'{parent}' {later}" if later else UnknownNameError("stage", parent, earlier)
        elif (file or usual_file(name, earlier[parent])) not in KINDS[earlier[parent].kind].outputs:
            outputs = ", ".join(KINDS[earlier[parent].kind].outputs)
            yield (
                "inputs",
                f"input '{name}': {parent} does not write {file or usual_file(name, earlier[parent])}; {outputs}",
            )


def usual_file(name: str, parent: Stage) -> str:
    """Return which file of a stage an input takes by its name: env.starts takes starts.safetensors.

    Args:
        name: name of the input.
        parent: the stage.
    """
    own = f"{name.rpartition('.')[2]}.safetensors"
    outputs = KINDS[parent.kind].outputs
    if name in ("policy", "snapshot", "figures"):
        return {"policy": "policy.safetensors", "snapshot": "snapshot.safetensors", "figures": "figures.json"}[name]
    return own if own in outputs else "snapshot.safetensors"


def _setting_problems(stage: Stage) -> Iterator[tuple[str, object]]:
    """Yield what the settings refuse, at every measurement and every level of a gated schedule."""
    seen: set[str] = set()
    highest = max([len(s.values) for s in stage.schedules.values() if s.shape == "gated"], default=1)
    trials: list[tuple[float, int, Mapping[str, Any]]] = [
        (stage.progress_of(segment), level, {})
        for segment in range(min(stage.segments, 200))
        for level in range(highest)
    ]
    trials += [(0.0, 0, gate.change) for gate in stage.gates if gate.change]
    for progress, level, changes in trials:
        try:
            stage.config(progress, levels=dict.fromkeys(stage.schedules, level), changes=changes)
        except HugwbcError as error:
            if str(error) not in seen:
                seen.add(str(error))
                yield _named_in(str(error), [*stage.schedules, *stage.settings]), error
    if stage.segments > 10_000:
        yield "every", f"{stage.segments} measurements; give a larger 'every'"


def _named_in(message: str, names: list[str]) -> str:
    """Return the setting that a message is about, by its last word; empty if none is found."""
    head = message.partition("=")[0]
    return next((name for name in names if name.rpartition(".")[2] in head), "")
