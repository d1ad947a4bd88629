"""Contracts as YAML files; errors name the line that is wrong.

`contracts/unitree-h1.yaml` is an example; docs/evaluation.md describes every field.
"""

import math
import pathlib
from collections.abc import Mapping

import yaml

from hugwbc.errors import ContractError, UnknownNameError
from hugwbc.robot import load_robot
from hugwbc.runtime.foreign.contract import History, PolicyContract, Term, check_commands, check_joints
from hugwbc.runtime.foreign.observation import TERMS
from hugwbc.yaml_file import Read, YamlReader

FOLDER = pathlib.Path(__file__).parent / "contracts"
CONTRACT_NAMES = tuple(sorted(path.stem for path in FOLDER.glob("*.yaml")))
CONTRACT_FILE = "contract.yaml"
SHORTEST_PERIOD, LONGEST_PERIOD = 1e-3, 1.0  # [s]
_HINT = "a contract has the fields of docs/evaluation.md"
_REQUIRED = ("period", "joints", "default_pose", "kp", "kd", "action_scale", "observation")
_SIZES = {"angular_velocity": 3, "linear_velocity": 3, "gravity": 3, "phase_sin": 1, "phase_cos": 1}


def contract_path(name: str | pathlib.Path) -> pathlib.Path:
    """Return the path of a contract's file.

    Args:
        name: one of `CONTRACT_NAMES`, the path of a YAML file, or of a folder with a `contract.yaml`.

    Raises:
        UnknownNameError: if there is no such contract.
    """
    path = pathlib.Path(name)
    if str(name) in CONTRACT_NAMES:
        path = FOLDER / f"{name}.yaml"
    elif path.is_dir():
        path = path / CONTRACT_FILE
    if not path.is_file():
        raise UnknownNameError("contract", name, [*CONTRACT_NAMES, "the path of a contract file (.yaml)"])
    return path


def load_contract(name: str | pathlib.Path) -> PolicyContract:
    """Load a contract by name or path, as for `contract_path`.

    Raises:
        UnknownNameError: if there is no such contract.
        ContractError: if the file cannot be read or is not a valid contract; it names the line.
    """
    reader = _Reader(contract_path(name))
    return reader.contract(reader.load("contract", _HINT))


class _Reader(YamlReader):
    """A reader that turns YAML nodes into parts of a contract."""

    def __init__(self, path: pathlib.Path) -> None:
        super().__init__(path, ContractError)

    def contract(self, root: yaml.Node) -> PolicyContract:
        raw: Read = lambda reader, node: node  # noqa: E731  these are read once the joints are known
        readers: dict[str, Read] = {
            "name": _Reader.text,
            "policy": _Reader.text,
            "period": lambda reader, node: reader.between(node, SHORTEST_PERIOD, LONGEST_PERIOD),
            "joints": _Reader.joints,
            **dict.fromkeys(("default_pose", "kp", "kd", "action_scale", "observation", "held_pose"), raw),
            "action_clip": _Reader.positive,
            "observation_clip": _Reader.positive,
            "history": _Reader.history,
            "state": _Reader.state,
            "clock": _Reader.clock,
        }
        fields = self.fields(root, "contract", readers, required=_REQUIRED)
        joints, policy = fields["joints"], fields.pop("policy", None)
        clock, held = fields.pop("clock", "command"), fields.pop("held_pose", None)
        for name in ("default_pose", "kp", "kd", "action_scale"):
            fields[name] = self.numbers(fields[name], len(joints), "one per joint")
        terms = tuple(self.term(node, joints) for node in self.nodes(fields["observation"]))
        return PolicyContract(
            **{**fields, "name": fields.get("name", self.path.stem), "observation": terms},
            policy=None if policy is None else self.path.parent / policy,
            clock_period=None if clock == "command" else clock,
            held_pose=() if held is None else self.held_pose(held, joints),
        )

    def term(self, node: yaml.Node, joints: tuple[str, ...]) -> Term:
        """Read one entry of the observation: the name of a kind, or a mapping from it to its fields."""
        kind, settings = node, None
        if isinstance(node, yaml.MappingNode):
            if len(node.value) != 1:
                self.fail(node, "an entry of the observation has one name; start each with its own '-'")
            ((kind, settings),) = node.value
        name = self.text(kind)
        if name not in TERMS:
            self.fail(kind, UnknownNameError("observation term", name, TERMS))
        readers: dict[str, Read] = {"scale": lambda reader, value: value}
        required: tuple[str, ...] = ()
        if name in ("joint_position", "joint_velocity"):
            readers["joints"] = _Reader.joints
        if name == "joint_position":
            readers["absolute"] = _Reader.truth
        if name.startswith("phase_"):
            readers["offset"] = _Reader.finite
        if name == "command":
            readers["names"], required = _Reader.commands, ("names",)
        if name == "constant":
            readers["value"], required = _Reader.constant, ("value",)
        fields: dict = {}
        if settings is not None:
            fields = self.fields(settings, f"{name}", readers, required)
        elif required:
            self.fail(node, f"{name} needs {', '.join(required)}, as in {name}: {{{required[0]}: [...]}}")
        return self._made(name, fields, joints)

    def _made(self, name: str, fields: dict, joints: tuple[str, ...]) -> Term:
        names = fields.get("names", fields.pop("joints", joints if name.startswith("joint_") else ()))
        counts = {"last_action": len(joints), "constant": len(fields.get("value", ()))}
        size = _SIZES.get(name, counts.get(name, len(names)))
        scale = fields.pop("scale", None)
        factors = (1.0,) * size if scale is None else self.numbers(scale, size, f"one per number of {name}")
        return Term(kind=name, size=size, scale=factors, **{**fields, "names": tuple(names)})

    def finite(self, node: yaml.Node) -> float:
        return self.between(node, -math.inf, math.inf)

    def positive(self, node: yaml.Node) -> float:
        value = self.finite(node)
        if value <= 0.0:
            self.fail(node, f"{value:g} is not above 0")
        return value

    def between(self, node: yaml.Node, low: float, high: float) -> float:
        value = self.number(node)
        if not (math.isfinite(value) and low <= value <= high):
            limits = "a finite number" if math.isinf(high) else f"a number from {low:g} to {high:g}"
            self.fail(node, f"{value:g} is not valid; give {limits}")
        return value

    def numbers(self, node: yaml.Node, count: int, what: str) -> tuple[float, ...]:
        """Read `count` numbers; a single number stands for all of them."""
        if isinstance(node, yaml.ScalarNode):
            return (self.finite(node),) * count
        entries = self.nodes(node)
        if len(entries) != count:
            self.fail(node, f"found {len(entries)} numbers; give {count}, {what}, or a single one for all")
        return tuple(self.finite(entry) for entry in entries)

    def joints(self, node: yaml.Node) -> tuple[str, ...]:
        if isinstance(node, yaml.ScalarNode) and node.value == "all":
            return load_robot().joint_names
        return self.checked(node, check_joints, tuple(self.text(entry) for entry in self.nodes(node)))

    def commands(self, node: yaml.Node) -> tuple[str, ...]:
        return self.checked(node, check_commands, tuple(self.text(entry) for entry in self.nodes(node)))

    def constant(self, node: yaml.Node) -> tuple[float, ...]:
        return tuple(self.finite(entry) for entry in self.nodes(node))

    def history(self, node: yaml.Node) -> History:
        readers = {"frames": _Reader.integer, **dict.fromkeys(("order", "layout", "start"), _Reader.text)}
        return self.checked(node, History, **self.fields(node, "history", readers, required=("frames",)))

    def state(self, node: yaml.Node) -> tuple[tuple[str, str], ...]:
        if not isinstance(node, yaml.MappingNode) or not node.value:
            self.fail(node, "expected names of state inputs and outputs, as in state: {h_in: h_out}")
        return tuple((self.text(key), self.text(value)) for key, value in node.value)

    def clock(self, node: yaml.Node) -> float | str:
        def period(reader: "_Reader", value: yaml.Node) -> float | str:
            if isinstance(value, yaml.ScalarNode) and value.value == "command":
                return "command"
            return reader.positive(value)

        return self.fields(node, "clock", {"period": period}, required=("period",))["period"]

    def held_pose(self, node: yaml.Node, joints: tuple[str, ...]) -> tuple[tuple[str, float], ...]:
        free = [name for name in load_robot().joint_names if name not in joints]
        fields: Mapping[str, float] = self.fields(node, "held_pose", dict.fromkeys(free, _Reader.finite))
        return tuple(fields.items())
