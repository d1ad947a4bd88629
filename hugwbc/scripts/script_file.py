"""Scripts as YAML files; errors name the line that is wrong.

    segments:
      - label: wave
        duration: 3
        gait: standing            # optional, like everything but label and duration
        commands: {h: -0.1}
        ramp: 1
        hands:
          frame: pelvis           # pelvis, heading or world
          right_direction: [1, 0, 0]  # along which the forearm points; left_direction likewise
          together: true          # both hands hold one object
          whole_body: true        # h, p and w may help
          left: {line: {points: [[0.3, 0.3, 0.1], [0.3, 0.3, 0.3]], leg_time: 1, repeat: true}}
          right: mirror           # mirror image of the left; a hand that is left out rests
      - label: gesture
        duration: 5
        motion: wave.npz          # arm joints from a motion file (see `hugwbc.scripts.motion`), instead of hands

A path is one of `hold`, `line`, `grid`, `circle`, `swing` and `wander`, with the fields of the class of that name in
`scripts.hand_paths`, or `file`, the path of a CSV file (t, x, y, z). Paths of CSV and motion files are relative to the
script. YAML anchors may repeat parts.
"""

import dataclasses
import pathlib

import yaml

from hugwbc.commands import COMMAND_NAMES, Command
from hugwbc.errors import ScriptError
from hugwbc.gait import Gait
from hugwbc.scripts import hand_paths
from hugwbc.scripts.hand_paths import HandPath
from hugwbc.scripts.motion import ArmMotion, load_motion
from hugwbc.scripts.recorded_path import read_path
from hugwbc.scripts.script import DEFAULT_RAMP, HandMotion, Script, Segment, check_transition
from hugwbc.targets import HAND_FRAMES
from hugwbc.yaml_file import Read, YamlReader, shipped_names, yaml_path

FOLDER = pathlib.Path(__file__).parent
SCRIPT_NAMES = shipped_names(FOLDER)
REPLACED = {"carry_box": "fetch_box", "push_button": "press_button"}
"""Former scripts with imagined objects, and the tasks in which these are real."""
_HINT = "write `segments:` and below it a list, each with label and duration; `file` names long paths"


def load_script(name: str | pathlib.Path) -> Script:
    """Load a shipped script by name, or a script from a YAML file.

    Args:
        name: one of `SCRIPT_NAMES`, or the path of a file that ends in .yaml or .yml.

    Raises:
        UnknownNameError: if no shipped script has that name.
        ScriptError: if the file cannot be read or is not a valid script; it names the line. Or if the script has become
            a task.
    """
    if str(name) in REPLACED:
        raise ScriptError(
            f"script '{name}' is a task now, with real objects in place of imagined ones: give `--task "
            f"{REPLACED[str(name)]}` to play or compare, or load_task('{REPLACED[str(name)]}') in Python"
        )
    return read_script(yaml_path("script", name, FOLDER))


def read_script(path: pathlib.Path) -> Script:
    """Read a script from a YAML file; its name is that of the file.

    Raises:
        ScriptError: if the file cannot be read or is not a valid script; it names the line.
    """
    reader = _Reader(path)
    return reader.script(reader.load("script", _HINT))


def parse_script(text: str, path: pathlib.Path) -> Script:
    """Parse a script from YAML text.

    Args:
        text: the YAML text.
        path: path that gives the name, stands in the messages, and is the base of relative paths.

    Raises:
        ScriptError: if the text is not a valid script; it names the line.
    """
    reader = _Reader(path)
    return reader.script(reader.compose(text, _HINT))


class _Reader(YamlReader):
    """A reader that turns YAML nodes into parts of a script."""

    def __init__(self, path: pathlib.Path) -> None:
        super().__init__(path, ScriptError)
        self._motions: dict[pathlib.Path, ArmMotion] = {}

    def script(self, root: yaml.Node) -> Script:
        fields = self.fields(root, "script", {"segments": _Reader.nodes, "about": _Reader.text}, required=("segments",))
        nodes = fields["segments"]
        segments = [self.segment(node) for node in nodes]
        for index in range(1, len(segments)):
            self.checked(nodes[index], check_transition, segments[index - 1], segments[index])
        return self.checked(root, Script, self.path.stem, tuple(segments), fields.get("about", ""))

    def segment(self, node: yaml.Node) -> Segment:
        readers: dict[str, Read] = {
            "label": _Reader.text,
            "duration": _Reader.number,
            "gait": _Reader.gait,
            "commands": lambda reader, value: value,
            "hands": _Reader.hands,
            "ramp": _Reader.number,
            "motion": _Reader.motion,
        }
        fields = self.fields(node, "segment", readers, required=("label", "duration"))
        if "commands" in fields:
            fields["commands"] = self.commands(fields["commands"], fields.get("gait", Gait.STANDING))
        if "ramp" not in fields and fields["duration"] > 0.0:
            fields["ramp"] = min(DEFAULT_RAMP, fields["duration"])
        return self.checked(node, Segment, **fields)

    def motion(self, node: yaml.Node) -> ArmMotion:
        """Return the same object for the same file, so that a motion can continue from segment to segment."""
        path = self.path.parent / self.text(node)
        if path not in self._motions:
            self._motions[path] = self.checked(node, load_motion, path)
        return self._motions[path]

    def commands(self, node: yaml.Node, gait: Gait) -> dict[str, float]:
        values = self.fields(node, "command", dict.fromkeys(COMMAND_NAMES, _Reader.number))
        assert isinstance(node, yaml.MappingNode)
        for key, value in node.value:
            command = Command.from_mapping({key.value: values[key.value]}, gait)
            self.checked(value, command.validate)
        return values

    def hands(self, node: yaml.Node) -> HandMotion | None:
        if isinstance(node, yaml.ScalarNode) and node.tag.endswith(":null"):
            return None
        readers = {
            "frame": _Reader.frame,
            "left": _Reader.hand,
            "right": _Reader.hand,
            "left_direction": _Reader.point,
            "right_direction": _Reader.point,
            "together": _Reader.truth,
            "whole_body": _Reader.truth,
        }
        fields = self.fields(node, "hands", readers)
        left, right = fields.pop("left", None), fields.pop("right", None)
        if left == right == "mirror":
            self.fail(node, "both hands mirror each other; give one of them a path")
        if left == "mirror" and isinstance(right, HandPath):
            left = right.mirrored()
        if right == "mirror" and isinstance(left, HandPath):
            right = left.mirrored()
        if "mirror" in (left, right):
            self.fail(node, "there is no path to mirror; give the other hand a path")
        return self.checked(node, HandMotion, left, right, **fields)

    def hand(self, node: yaml.Node) -> HandPath | str:
        if isinstance(node, yaml.ScalarNode) and node.value == "mirror":
            return "mirror"
        kinds = dict.fromkeys((*_PATHS, "file"), lambda reader, value: value)
        found = self.fields(node, "path", kinds)
        if len(found) != 1:
            self.fail(node, f"a hand has one path, found {len(found)}; give one of {', '.join(kinds)}, or mirror")
        ((kind, value),) = found.items()
        if kind == "file":
            return self.checked(value, read_path, self.path.parent / self.text(value))
        cls = _PATHS[kind]
        if kind == "hold" and isinstance(value, yaml.SequenceNode):
            return self.checked(value, cls, self.point(value))
        readers = {field.name: _FIELDS[str(field.type)] for field in dataclasses.fields(cls)}
        required = [f.name for f in dataclasses.fields(cls) if f.default is dataclasses.MISSING]
        return self.checked(value, cls, **self.fields(value, kind, readers, required=required))

    def point(self, node: yaml.Node) -> tuple[float, ...]:
        if not isinstance(node, yaml.SequenceNode) or len(node.value) != 3:
            self.fail(node, "expected three numbers [x, y, z]")
        return tuple(self.number(entry) for entry in node.value)

    def points(self, node: yaml.Node) -> tuple[tuple[float, ...], ...]:
        return tuple(self.point(entry) for entry in self.nodes(node))

    def gait(self, node: yaml.Node) -> Gait:
        return self.checked(node, Gait.parse, self.text(node))

    def frame(self, node: yaml.Node) -> str:
        return self.one_of(node, "hand frame", HAND_FRAMES)


_PATHS: dict[str, type[HandPath]] = {
    "hold": hand_paths.Hold,
    "line": hand_paths.Line,
    "grid": hand_paths.Grid,
    "circle": hand_paths.Circle,
    "swing": hand_paths.Swing,
    "wander": hand_paths.Wander,
}
# A reader for each type of the paths' fields.
_FIELDS: dict[str, Read] = {
    str(field.type): read
    for cls, name, read in (
        (hand_paths.Hold, "point", _Reader.point),
        (hand_paths.Line, "points", _Reader.points),
        (hand_paths.Line, "leg_time", _Reader.number),
        (hand_paths.Line, "repeat", _Reader.truth),
        (hand_paths.Grid, "count", _Reader.point),
        (hand_paths.Circle, "axis", _Reader.text),
        (hand_paths.Wander, "seed", _Reader.integer),
    )
    for field in dataclasses.fields(cls)
    if field.name == name
}
