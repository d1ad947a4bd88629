"""Controllers by name or path, as on the command line: built-in, plug-in, policy folder, or foreign policy.

A plug-in is an entry point in the group `hugwbc.controllers`: a callable that returns an object with the members of
`hugwbc.controller.Controller`. If the callable has a parameter `policy`, it receives the value of --policy, or None; if
it has a parameter `robot`, it receives the `Robot` that the controller is told, with its drives, or None for the
default one.
The built-in controllers are registered in the same way.
"""

import dataclasses
import functools
import hashlib
import importlib.metadata
import inspect
import pathlib
from collections.abc import Callable
from importlib.metadata import EntryPoint
from typing import Any

import numpy as np

import hugwbc
from hugwbc.commands import Command
from hugwbc.controller import Controller, JointCommand, UpperBody, override_arms
from hugwbc.errors import ConfigError, PolicyFileError, UnknownNameError
from hugwbc.robot import DEFAULT_ROBOT, Robot, load_robot
from hugwbc.runtime.foreign.contract_file import CONTRACT_FILE, CONTRACT_NAMES, contract_path, load_contract
from hugwbc.runtime.foreign.network import SUFFIXES
from hugwbc.sim.arena import DEFAULT_DRIVES, Arena, known_robot
from hugwbc.state import RobotState

GROUP = "hugwbc.controllers"
# The same entries as in pyproject.toml, for a source tree that is not installed and therefore has no metadata.
_OURS = {
    "learned": "hugwbc.runtime.controllers:learned_controller",
    "qp": "hugwbc.mbc:WholeBodyController",
    "hold": "hugwbc.runtime.controllers:HoldController",
}
_PATHS = "the path of a policy folder or file, or of a contract (.yaml)"


class HoldController:
    """A baseline that does not balance: it holds the nominal pose by PD and turns the waist as commanded."""

    name = "hold"
    period = 0.02

    def __init__(self, robot: Robot | None = None) -> None:
        self.robot = robot or load_robot()

    def reset(self, state: RobotState) -> None:
        """Do nothing; there is no past to forget."""

    def act(self, state: RobotState, command: Command, upper_body: UpperBody) -> JointCommand:
        """Return the nominal pose with the commanded waist angle and external arm targets."""
        q = self.robot.nominal.copy()
        q[self.robot.waist] = command.w
        return override_arms(JointCommand.position(self.robot, np.asarray(q)), upper_body, self.robot)


def learned_controller(policy: str | pathlib.Path | None = None) -> Controller:
    """Load the HugWBC policy.

    Args:
        policy: name of a shipped policy, a policy file or its folder; None for the default policy.

    Raises:
        PolicyFileError: if the policy file is missing, truncated or foreign.
    """
    from hugwbc.learned.policy import load_policy

    return load_policy() if policy is None else load_policy(policy)


def load_controller(
    name: str,
    policy: str | pathlib.Path | None = None,
    robot: str | None = None,
    drives: str | None = None,
) -> Controller:
    """Build a controller.

    Args:
        name: one of `controller_names()`, or the path of a policy or of a contract (`ControllerSpec`).
        policy: name of a shipped policy or path of a policy, for a controller that takes one.
        robot: name of the robot that a model-based controller is told, such as "h1-2023"; None for the default one.
        drives: drives that it is told, "real" or "ideal"; None for real ones.

    Raises:
        UnknownNameError: if neither a controller nor a file has that name, or no robot or drives have theirs.
        ConfigError: if the controller does not take a policy, or is told no robot.
        ContractError: if a contract is malformed.
        PolicyFileError: if a policy file is missing, truncated or foreign.
    """
    return ControllerSpec(name, policy, robot, drives).build()


@functools.cache
def plugins() -> dict[str, EntryPoint]:
    """Return the registered controllers by name, the built-in ones first.

    Raises:
        ConfigError: if two packages register different controllers under one name.
    """
    found = {name: EntryPoint(name, value, GROUP) for name, value in _OURS.items()}
    for entry in importlib.metadata.entry_points(group=GROUP):
        other = found.setdefault(entry.name, entry)
        if other.value != entry.value:
            raise ConfigError(
                f"two controllers are registered as '{entry.name}': {other.value} and {entry.value}; uninstall one of "
                "the packages, or let it register another name"
            )
    return found


def controller_names() -> tuple[str, ...]:
    """Return the names of the registered controllers and of the shipped contracts of foreign policies."""
    return (*plugins(), *CONTRACT_NAMES)


@dataclasses.dataclass(frozen=True)
class ControllerSpec:
    """A controller by name or path, cheap to send to another process that builds it.

    Attributes:
        name: one of `controller_names()`, the path of a policy file or its folder, or the path of a foreign policy's
            contract or of a folder with a `contract.yaml`.
        policy: for the learned controller, the name of a shipped policy or the path of a policy file; for a foreign
            policy, the file of its network; for a plug-in, whatever it takes; None for the default.
        robot: name of the robot that the controller is told, for one that takes a robot; None for the default. The
            simulated robot may be another one.
        drives: drives that it is told, "real" or "ideal"; None for the default, real ones.
    """

    name: str
    policy: str | pathlib.Path | None = None
    robot: str | None = None
    drives: str | None = None

    def __post_init__(self) -> None:
        path = pathlib.Path(self.name)
        if self.name not in controller_names() and path.suffix in SUFFIXES:
            raise ConfigError(
                f"{path} is a bare network; write a contract for it as docs/evaluation.md says, and give the contract"
            )
        if self.name not in controller_names() and not path.exists():
            raise UnknownNameError("controller", self.name, (*controller_names(), _PATHS))
        if self.policy is not None and not self._is_foreign:
            self._check_policy()
        given = [f"'{word}'" for word in (self.robot, self.drives) if word is not None]
        if given:
            _ = self._known_robot
            if not self.takes_robot:
                raise ConfigError(
                    f"controller '{self.name}' is not told a robot: it has no model of one, or learned one in its "
                    f"training; leave out {' and '.join(given)}, or choose a controller that takes a robot, such as qp"
                )

    def _check_policy(self) -> None:
        """Refuse a policy that would not be used.

        Raises:
            ConfigError: if the controller does not take a policy.
        """
        if self.name not in plugins():
            raise ConfigError(f"controller '{self.name}' takes no policy because it is one; leave out '{self.policy}'")
        if not _takes(_loaded(plugins()[self.name]), "policy"):
            raise ConfigError(
                f"controller '{self.name}' takes no policy; leave out '{self.policy}', or choose a controller that "
                "takes one, such as learned"
            )

    @classmethod
    def parse(cls, words: str) -> "ControllerSpec":
        """Build a spec from `NAME` or `NAME=POLICY`, the form used in lists of controllers on the command line."""
        name, equals, policy = words.partition("=")
        return cls(name, policy) if equals and name in controller_names() else cls(words)

    @property
    def takes_robot(self) -> bool:
        """Whether the controller can be told a robot; a policy cannot, since it has learned one.

        Raises:
            ConfigError: if a plug-in cannot be loaded.
        """
        return self.name in plugins() and _takes(_loaded(plugins()[self.name]), "robot")

    def told(self, arena: Arena) -> "ControllerSpec":
        """Return the controller told the robot and the drives of an arena; unchanged if it takes no robot."""
        if not self.takes_robot:
            return self
        robot = None if arena.robot == DEFAULT_ROBOT else arena.robot
        drives = None if arena.drives == DEFAULT_DRIVES else arena.drives
        return dataclasses.replace(self, robot=robot, drives=drives)

    @property
    def _known_robot(self) -> Robot | None:
        """What the controller is told of the robot; None for the default."""
        if self.robot is None and self.drives is None:
            return None
        return known_robot(self.robot or DEFAULT_ROBOT, self.drives or DEFAULT_DRIVES)

    @property
    def label(self) -> str:
        """Short name for tables, which includes the policy, the robot and the drives."""
        name = self.name if self.name in controller_names() else pathlib.Path(self.name).stem
        policy = None if self.policy is None else pathlib.Path(self.policy).stem
        drives = None if self.drives is None else f"{self.drives} drives"
        return " ".join(word for word in (name, policy, self.robot, drives) if word is not None)

    def build(self) -> Controller:
        """Build the controller, ready to `reset`.

        Raises:
            ContractError: if a contract is malformed.
            PolicyFileError: if a policy file is missing, truncated or foreign.
            ConfigError: if a plug-in cannot be loaded or does not return a controller.
        """
        if self.name in plugins():
            return _build_plugin(plugins()[self.name], self.policy, self._known_robot)
        if self._is_foreign:
            from hugwbc.runtime.foreign import load_foreign_policy

            return load_foreign_policy(self.name, self.policy)
        return learned_controller(self.name)

    @property
    def _is_foreign(self) -> bool:
        path = pathlib.Path(self.name)
        in_folder = path.is_dir() and (path / CONTRACT_FILE).is_file()
        return self.name in CONTRACT_NAMES or in_folder or path.suffix in (".yaml", ".yml")

    @property
    def training(self) -> str | None:
        """The paper's kind of arm motion in training; None for a controller that was not trained or does not say.

        Raises:
            PolicyFileError: if a policy file is missing, truncated or foreign.
        """
        if self._is_foreign or (self.name in plugins() and self.name != "learned"):
            return None
        from hugwbc.learned.policy import trained_with

        (path,) = self.files()
        return trained_with(path)

    def identity(self) -> dict[str, Any]:
        """Return what the behaviour depends on, as JSON: name, package, modules, digests of files.

        Equal controllers have equal identities on any machine, because no path is part of it.

        Raises:
            PolicyFileError: if one of the files is missing.
        """
        missing = [path for path in self.files() if not path.is_file()]
        if missing:
            raise PolicyFileError(f"there is no policy file {missing[0]}; give the path of one")
        entry = plugins().get(self.name)
        dist = None if entry is None else entry.dist
        package = f"hugwbc {hugwbc.__version__}" if dist is None else f"{dist.name} {dist.version}"
        return {
            "name": self.name if entry is not None or self.name in CONTRACT_NAMES else "file",
            "package": package,
            "modules": [entry.value.partition(":")[0] if entry else "hugwbc.runtime.controllers"],
            "files": [hashlib.sha256(path.read_bytes()).hexdigest() for path in self.files()],
            "policy": self._policy_word,
            **(self._told_names if self.takes_robot else {}),
        }

    @property
    def _told_names(self) -> dict[str, str]:
        return {"robot": self.robot or DEFAULT_ROBOT, "drives": self.drives or DEFAULT_DRIVES}

    @property
    def _policy_word(self) -> str | None:
        """A plug-in's policy that is neither a file nor a folder, but a word that only the plug-in knows."""
        ours = self.name not in plugins() or self.name in _OURS
        given = None if self.policy is None or ours else pathlib.Path(self.policy)
        return None if given is None or given.exists() else str(self.policy)

    def files(self) -> list[pathlib.Path]:
        """Return the files that the controller is built from: contract and network, or policy."""
        given = None if self.policy is None else pathlib.Path(self.policy)
        if self._is_foreign:
            contract = contract_path(self.name)
            network = given or load_contract(contract).policy
            return [contract, *([] if network is None else [network])]
        from hugwbc.learned.policy import DEFAULT_POLICY, policy_file

        if self.name not in plugins():
            return [policy_file(self.name)]
        if self.name == "learned":
            return [policy_file(given or DEFAULT_POLICY)]
        if given is not None and given.is_dir():
            return sorted(path for path in given.rglob("*") if path.is_file())
        return [] if given is None or not given.is_file() else [given]


def _loaded(entry: EntryPoint) -> Callable[..., Any]:
    """Load the callable that builds a plug-in.

    Raises:
        ConfigError: if it cannot be loaded.
    """
    try:
        return entry.load()
    except (ImportError, AttributeError) as error:
        raise ConfigError(
            f"controller '{entry.name}' ({entry.value}) cannot be loaded: {error}; install its package again"
        ) from error


def _takes(factory: Callable[..., Any], parameter: str) -> bool:
    return parameter in inspect.signature(factory).parameters


def _build_plugin(entry: EntryPoint, policy: str | pathlib.Path | None, robot: Robot | None) -> Controller:
    """Build a plug-in and check that it is a controller."""
    factory = _loaded(entry)
    given = {name: value for name, value in (("policy", policy), ("robot", robot)) if _takes(factory, name)}
    controller = factory(**given)
    if not isinstance(controller, Controller):
        missing = [name for name in ("name", "period", "reset", "act") if not hasattr(controller, name)]
        raise ConfigError(
            f"controller '{entry.name}' ({entry.value}) gives a {type(controller).__name__} without "
            f"{', '.join(missing)}; see hugwbc.controller.Controller"
        )
    return controller
