"""Behaviours as YAML files; errors name the line and the column that are wrong.

    about: Walk to a box, take it and bring it to the bench.
    steps:
      - walk_to: {before: parcel, distance: 0.45}
      - retry:
          times: 3
          do:
            - squeeze: {object: parcel, force: 40}
            - lift: {object: parcel, height: 0.1}
          between: [release]
      - carry: {object: parcel, before: bench, distance: 0.55}
      - wait_until: {elapsed: {seconds: 1}}
      - place: {object: parcel, lower: 0.5}
      - on_failure:
          do: [{face: {yaw: 0}}]
          then: [release]
          recovers: false
      - parallel:
          legs: [{walk_to: {position: [0, 0]}}]
          hands: [{reach: {left: [0.3, 0.3, 0.1]}}]

A step is the name of a class in `hugwbc.scripts.behaviours`, in small letters, with the arguments of its constructor.
`do`, `then`, `between`, `legs` and `hands` are lists of steps. YAML anchors may repeat parts.
"""

import inspect
import pathlib
from collections.abc import Collection, Mapping
from typing import Any

import yaml

from hugwbc.errors import HugwbcError, ScriptError, UnknownNameError
from hugwbc.scripts.behaviours import conditions, hand_steps, haul_steps, hold_steps, walk_steps
from hugwbc.scripts.behaviours.behaviour import Behaviour
from hugwbc.scripts.behaviours.composition import OnFailure, Parallel, Retry, Sequence, WaitUntil, in_order
from hugwbc.scripts.script import Script
from hugwbc.scripts.script_file import SCRIPT_NAMES, load_script
from hugwbc.targets import HAND_FRAMES
from hugwbc.yaml_file import Read, YamlReader, shipped_names, yaml_path

FOLDER = pathlib.Path(__file__).parent
BEHAVIOUR_NAMES = shipped_names(FOLDER)
MOST_STEPS = 1000  # in a file, those of repeated parts counted as often as they are repeated
DEEPEST = 20  # levels of steps within steps
_HINT = "write `steps:` and below it a list, such as `- walk_to: {position: [1, 0]}`"
STEPS: Mapping[str, type[Behaviour]] = {
    "walk_to": walk_steps.WalkTo,
    "face": walk_steps.Face,
    "reach": hand_steps.Reach,
    "move_hands": hand_steps.MoveHands,
    "press": hand_steps.Press,
    "wipe": hand_steps.Wipe,
    "grasp": hold_steps.Grasp,
    "squeeze": hold_steps.Squeeze,
    "attach": hold_steps.Attach,
    "lift": hold_steps.Lift,
    "carry": hold_steps.Carry,
    "place": hold_steps.Place,
    "release": hold_steps.Release,
    "push": haul_steps.Push,
    "pull": haul_steps.Pull,
    "stand": haul_steps.Stand,
}
CONDITIONS: Mapping[str, type[Any]] = {
    "arrived": conditions.Arrived,
    "contact": conditions.Contact,
    "elapsed": conditions.Elapsed,
    "force_above": conditions.ForceAbove,
    "lifted": conditions.Lifted,
    "moved": conditions.Moved,
}
COMPOSITES = ("sequence", "parallel", "retry", "on_failure", "wait_until")


def load_behaviour(name: str | pathlib.Path) -> Behaviour:
    """Load a shipped behaviour by name, or a behaviour from a YAML file.

    Args:
        name: one of `BEHAVIOUR_NAMES`, or the path of a file that ends in .yaml or .yml.
    """
    reader = _Reader(yaml_path("behaviour", name, FOLDER), ScriptError)
    return reader.behaviour(reader.load("behaviour", _HINT))


def parse_behaviour(text: str, path: pathlib.Path) -> Behaviour:
    """Parse a behaviour from YAML text.

    Args:
        text: the YAML text.
        path: path that gives the name and stands in the messages.
    """
    reader = _Reader(path, ScriptError)
    return reader.behaviour(reader.compose(text, _HINT))


def load_plan(name: str | pathlib.Path) -> Script | Behaviour:
    """Load a timed script or a behaviour: the name of a shipped one, or a YAML file.

    Args:
        name: a name, or the path of a file that ends in .yaml or .yml; one with `steps:` is a behaviour, one with
            `segments:` a script.
    """
    path = pathlib.Path(name)
    if path.suffix in (".yaml", ".yml"):
        reader = _Reader(path, ScriptError)
        return reader.plan(reader.load("script", f"{_HINT}, or `segments:` for a timed script"))
    if str(name) in BEHAVIOUR_NAMES:
        return load_behaviour(name)
    if str(name) not in SCRIPT_NAMES:
        raise UnknownNameError("script", name, (*SCRIPT_NAMES, *BEHAVIOUR_NAMES, "or a file that ends in .yaml"))
    return load_script(name)


def check_objects(plan: object, names: Collection[str]) -> None:
    """Check that the objects which a behaviour from a file names are there, before the robot moves.

    Args:
        plan: what plays; timed scripts and behaviours made in Python say nothing of objects.
        names: names of the objects in the scene (`Scene.body_names`); empty without one.
    """
    for name, place in (plan.mentions if isinstance(plan, Sequence) else {}).items():
        if name not in names:
            problem = UnknownNameError("object", name, names) if names else f"there is no object '{name}'."
            raise ScriptError(f"{place}: {problem} Give the scene that has it, or mend the name.")


class _Reader(YamlReader):
    """A reader that turns YAML nodes into behaviours."""

    _count = 0
    _depth = 0

    def __init__(self, path: pathlib.Path, error: type[HugwbcError]) -> None:
        super().__init__(path, error)
        self._mentions: dict[str, str] = {}

    def object_name(self, node: yaml.Node) -> str:
        """Return the name of an object, and remember where it is first named."""
        name = self.text(node)
        if not name:
            self.fail(node, "expected the name of an object, found nothing")
        self._mentions.setdefault(name, self.place(node))
        return name

    def frame(self, node: yaml.Node) -> str:
        """Return the name of a frame: one of `HAND_FRAMES`, or that of an object."""
        return self.text(node) if self.text(node) in HAND_FRAMES else self.object_name(node)

    def plan(self, root: yaml.Node) -> Script | Behaviour:
        keys = [key.value for key, _ in root.value] if isinstance(root, yaml.MappingNode) else []
        return self.behaviour(root) if "steps" in keys else load_script(self.path)

    def behaviour(self, root: yaml.Node) -> Behaviour:
        fields = self.fields(root, "behaviour", {"steps": _Reader.steps, "about": _Reader.text}, required=("steps",))
        return Sequence(*fields["steps"], name=self.path.stem, about=fields.get("about", ""), mentions=self._mentions)

    def steps(self, node: yaml.Node) -> list[Behaviour]:
        """Return the behaviours of a list."""
        self._depth += 1
        if self._depth > DEEPEST:
            self.fail(node, f"steps are nested more than {DEEPEST} levels deep; write them one after another")
        found = [self.step(entry) for entry in self.nodes(node)]
        self._depth -= 1
        return found

    def one(self, node: yaml.Node) -> Behaviour:
        """Return the steps of a list as one behaviour."""
        return in_order(self.steps(node))

    def step(self, node: yaml.Node) -> Behaviour:
        self._count += 1
        if self._count > MOST_STEPS:
            self.fail(node, f"there are more than {MOST_STEPS} steps; repeat fewer parts")
        name_node, value = self._named(node, "step", (*STEPS, *COMPOSITES))
        name = name_node.value
        if name in STEPS:
            return self._made(node, value, name, STEPS[name])
        return getattr(self, f"_{name}")(node, value)

    def _named(self, node: yaml.Node, what: str, names: tuple[str, ...]) -> tuple[yaml.Node, yaml.Node | None]:
        """Return the name of `- name: {...}` or `- name`, and what belongs to it."""
        if isinstance(node, yaml.ScalarNode):
            key, value = node, None
        elif isinstance(node, yaml.MappingNode) and len(node.value) == 1:
            key, value = node.value[0]
        else:
            self.fail(node, f"expected one {what}, such as `{names[0]}: {{...}}`; begin each with `- `")
        if not isinstance(key, yaml.ScalarNode) or key.value not in names:
            self.fail(key, UnknownNameError(what, key.value if isinstance(key, yaml.ScalarNode) else "", names))
        empty = isinstance(value, yaml.ScalarNode) and value.tag.endswith(":null")
        return key, None if empty else value

    def _fields_of(
        self, node: yaml.Node, value: yaml.Node | None, name: str, readers: dict[str, Read], required: list[str]
    ) -> dict[str, Any]:
        if value is None:
            if required:
                self.fail(node, f"{name} needs {', '.join(required)}")
            return {}
        return self.fields(value, name, readers, required)

    def _made(self, node: yaml.Node, value: yaml.Node | None, name: str, cls: type[Any]) -> Any:  # noqa: ANN401
        readers, required = _arguments(cls)
        fields = self._fields_of(node, value, name, readers, required)
        return self.checked(value or node, cls, **fields)

    def _sequence(self, node: yaml.Node, value: yaml.Node | None) -> Behaviour:
        fields = self._fields_of(node, value, "sequence", {"do": _Reader.steps}, ["do"])
        return Sequence(*fields["do"])

    def _parallel(self, node: yaml.Node, value: yaml.Node | None) -> Behaviour:
        readers: dict[str, Read] = dict.fromkeys(("legs", "hands"), _Reader.one)
        return Parallel(**self._fields_of(node, value, "parallel", readers, ["legs", "hands"]))

    def _retry(self, node: yaml.Node, value: yaml.Node | None) -> Behaviour:
        readers: dict[str, Read] = {"do": _Reader.one, "times": _Reader.integer, "between": _Reader.one}
        fields = self._fields_of(node, value, "retry", readers, ["do"])
        return self.checked(value or node, Retry, fields.pop("do"), **fields)

    def _on_failure(self, node: yaml.Node, value: yaml.Node | None) -> Behaviour:
        readers: dict[str, Read] = {"do": _Reader.one, "then": _Reader.one, "recovers": _Reader.truth}
        fields = self._fields_of(node, value, "on_failure", readers, ["do", "then"])
        return OnFailure(fields.pop("do"), fields.pop("then"), **fields)

    def _wait_until(self, node: yaml.Node, value: yaml.Node | None) -> Behaviour:
        readers: dict[str, Read] = {
            **{name: _condition(name) for name in CONDITIONS},
            "timeout": _Reader.number,
            "hold": _Reader.number,
        }
        if value is None:
            self.fail(node, f"wait_until needs a condition: one of {', '.join(CONDITIONS)}")
        fields = self.fields(value, "wait_until", readers)
        found = [name for name in CONDITIONS if name in fields]
        if len(found) != 1:
            self.fail(value, f"wait_until has {len(found)} conditions; give one of {', '.join(CONDITIONS)}")
        return self.checked(value, WaitUntil, fields.pop(found[0]), **fields)

    def _numbers(self, node: yaml.Node, count: int) -> tuple[float, ...]:
        if not isinstance(node, yaml.SequenceNode) or len(node.value) != count:
            self.fail(node, f"expected {'three numbers [x, y, z]' if count == 3 else 'two numbers [x, y]'}")
        return tuple(self.number(entry) for entry in node.value)

    def point(self, node: yaml.Node) -> tuple[float, ...]:
        return self._numbers(node, 3)

    def pair(self, node: yaml.Node) -> tuple[float, ...]:
        return self._numbers(node, 2)

    def points(self, node: yaml.Node) -> tuple[tuple[float, ...], ...]:
        return tuple(self.point(entry) for entry in self.nodes(node))


def _condition(name: str) -> Read:
    def read(reader: _Reader, node: yaml.Node) -> conditions.Condition:
        empty = isinstance(node, yaml.ScalarNode) and (node.tag.endswith(":null") or not node.value)
        return reader._made(node, None if empty else node, name, CONDITIONS[name])

    return read


# Readers of arguments that name objects.
_NAMES: dict[str, Read] = {
    **dict.fromkeys(("object", "before", "on"), _Reader.object_name),
    "frame": _Reader.frame,
}
# A reader for each type of the others.
_READERS: dict[str, Read] = {
    "str": _Reader.text,
    "float": _Reader.number,
    "int": _Reader.integer,
    "bool": _Reader.truth,
    str(tuple[float, float]): _Reader.pair,
    str(tuple[float, float, float]): _Reader.point,
    str(tuple[tuple[float, float, float], ...]): _Reader.points,
}


def _arguments(cls: type[Any]) -> tuple[dict[str, Read], list[str]]:
    """Return a reader for each argument of a constructor, and the names of those that must be given."""
    readers: dict[str, Read] = {}
    required = []
    for argument in list(inspect.signature(cls.__init__).parameters.values())[1:]:
        if argument.kind is inspect.Parameter.VAR_KEYWORD:  # `Carry` takes what `WalkTo` takes
            readers = {**_arguments(walk_steps.WalkTo)[0], **readers}
            continue
        kind = argument.annotation
        name = kind.__name__ if isinstance(kind, type) and "[" not in str(kind) else str(kind)
        readers[argument.name] = _NAMES.get(argument.name) or _READERS[name.removesuffix(" | None")]
        if argument.default is inspect.Parameter.empty:
            required.append(argument.name)
    return readers, required
