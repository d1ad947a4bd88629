"""Controllers by name or path, as on the command line: built-in, the user's own, or a policy.

A controller of the user's own is an entry point in the group `hugwbc.controllers`, or `FILE.py:NAME`: a callable that
returns an object with the members of `hugwbc.controller.Controller`. If the callable has a parameter `policy`, it
receives the value of --policy, or None; if it has a parameter `robot`, it receives the `Robot` that the controller is
told, with its drives: the default one if none is given. The built-in controllers are registered in the same way.
"""

import dataclasses
import functools
import importlib
import inspect
import pathlib
from collections.abc import Callable, Sequence
from importlib.metadata import EntryPoint
from typing import Any

import numpy as np

import hugwbc
from hugwbc import extensions
from hugwbc.commands import Command
from hugwbc.controller import Controller, JointCommand, UpperBody, check_controller, override_arms
from hugwbc.errors import ConfigError, HugwbcError, PolicyFileError, UnknownNameError
from hugwbc.files import digest
from hugwbc.learned.policy import DEFAULT_POLICY, policy_file, shipped_contracts, shipped_policies
from hugwbc.robot import Robot
from hugwbc.robot_tables import DEFAULT_ROBOT
from hugwbc.settings import check_each_once
from hugwbc.sim.arena import DEFAULT_DRIVES, Arena
from hugwbc.state import RobotState

GROUP = "hugwbc.controllers"
# The same entries as in pyproject.toml, for a source tree that is not installed and therefore has no metadata.
_OURS = {
    "learned": "hugwbc.runtime.controllers:learned_controller",
    "qp": "hugwbc.mbc:WholeBodyController",
    "hold": "hugwbc.runtime.controllers:HoldController",
}
_PATHS = "FILE.py:NAME, the path of a policy folder or file (.safetensors, .onnx), or of a contract (.yaml)"
_KIND = "controller"
_CONTRACTS = (".yaml", ".yml")


class HoldController:
    """A baseline that does not balance: it holds the nominal pose by PD and turns the waist as commanded."""

    name = "hold"
    period = 0.02

    def __init__(self, robot: Robot) -> None:
        self.robot = robot

    def reset(self, state: RobotState) -> None:
        """Do nothing; there is no past to forget."""

    def act(self, state: RobotState, command: Command, upper_body: UpperBody) -> JointCommand:
        """Return the nominal pose with the commanded waist angle and external arm targets."""
        q = self.robot.nominal.copy()
        q[self.robot.waist] = command.w
        return override_arms(JointCommand.position(self.robot, np.asarray(q)), upper_body, self.robot)


def learned_controller(
    policy: str | pathlib.Path | None = None, network: str | pathlib.Path | None = None
) -> Controller:
    """Load a policy, ours or another project's.

    Args:
        policy: name of a shipped policy or contract, a policy file or its folder, an ONNX file that `hugwbc export`
            wrote, or a contract; None for the default policy, an H1's.
        network: for a contract, the file of its network; None for the one that it names.

    Raises:
        ConfigError: if torch or safetensors, which a file of weights needs, is not installed.
        PolicyFileError: if a file is missing or damaged, or the network does not fit its contract.
        UnknownNameError: if no policy is shipped under that name.
    """
    from hugwbc.learned.policy import network_policy

    path = policy_file(DEFAULT_POLICY if policy is None else policy)
    if path.suffix in _CONTRACTS:
        return network_policy.load_contract_policy(path, network)
    if path.suffix == ".onnx":
        return network_policy.load_onnx_policy(path)
    try:
        importlib.import_module("torch")
        importlib.import_module("safetensors")
    except ImportError as error:
        raise ConfigError(
            f"the learned policy needs {error.name}, which is not installed: run `pip install 'hugwbc[learned]'`. "
            "Without torch, the controller qp works, and a policy that `hugwbc export` wrote (--controller policy.onnx)"
        ) from error
    from hugwbc.learned.policy import load_policy

    return load_policy(path)


def load_controller(
    name: str,
    policy: str | pathlib.Path | None = None,
    robot: str | None = None,
    drives: str | None = None,
) -> Controller:
    """Build a controller; arguments and errors are those of `ControllerSpec` and its `build`.

    The learned controller without a policy takes the shipped one of the robot, and is not told the robot besides.
    """
    spec = ControllerSpec(name, policy)
    if robot is not None and name == "learned" and policy is None:
        spec = spec.of_robot(robot)
        spec._check_robot(robot)
        robot = None
    return dataclasses.replace(spec, robot=robot, drives=drives).build()


@functools.cache
def plugins() -> dict[str, EntryPoint]:
    """Return the registered controllers by name, the built-in ones first."""
    return extensions.registered(GROUP, _KIND, _OURS)


def controller_names() -> tuple[str, ...]:
    """Return the names of the registered controllers and of the shipped contracts of other projects' policies."""
    return (*plugins(), *shipped_contracts())


@dataclasses.dataclass(frozen=True)
class ControllerSpec:
    """A controller by name or path, cheap to send to another process that builds it.

    Attributes:
        name: one of `controller_names()`, `FILE.py:NAME` for a class or function in a Python file, or a policy: its
            file or folder, or the contract of another project's policy.
        policy: for the learned controller, the name of a shipped policy or the path of a policy; for a contract, the
            file of its network; for one of the user's own, whatever it takes; None for the default.
        robot: name of the robot that the controller is told, for one that takes a robot; None for the default. The
            simulated robot may be another one.
        drives: drives that it is told, "real" or "ideal"; None for the default, real ones.
    """

    name: str
    policy: str | pathlib.Path | None = None
    robot: str | None = None
    drives: str | None = None

    def __post_init__(self) -> None:
        path = None if self.name in plugins() or extensions.names_object(self.name) else self._check_path()
        if self.name == "learned" and self.policy is not None:
            _refuse_bare(pathlib.Path(self.policy))
        if path is None and (self.policy is not None or self.name not in plugins()):
            if not _takes(self._factory, "policy") and self.policy is not None:
                raise ConfigError(
                    f"controller '{self.name}' takes no policy; leave out '{self.policy}', or choose a controller that "
                    "takes one, such as learned"
                )
        elif self.policy is not None and path is not None and path.suffix not in _CONTRACTS:
            raise ConfigError(f"controller '{self.name}' takes no policy because it is one; leave out '{self.policy}'")
        given = [f"'{word}'" for word in (self.robot, self.drives) if word is not None]
        if given:
            _ = self._known_robot
            if not self.takes_robot:
                if self.robot is not None:
                    self._check_robot(self.robot)
                raise ConfigError(
                    f"controller '{self.name}' is not told a robot: it has no model of one, or learned one in its "
                    f"training; leave out {' and '.join(given)}, or choose a controller that takes a robot, such as qp"
                )

    def _check_path(self) -> pathlib.Path:
        """Return the file of a policy; refuse others."""
        path = pathlib.Path(self.name)
        if path.suffix == extensions.SUFFIX:
            raise ConfigError(f"{path} is a Python file; say what makes the controller in it: {path}:NAME")
        _refuse_bare(path)
        try:
            path = policy_file(self.name)
        except UnknownNameError:
            raise UnknownNameError(_KIND, self.name, (*controller_names(), _PATHS)) from None
        if not path.exists():
            raise ConfigError(
                f"no installed package registers a controller '{self.name}', and the folder of that name holds no "
                f"{path.name}; install the package, or give FILE.py:NAME or a policy's path"
            )
        return path

    @property
    def _factory(self) -> Callable[..., Any]:
        """What builds the controller."""
        if self.name in plugins():
            entry = plugins()[self.name]
            factory, origin = extensions.load_entry(entry, _KIND), f"controller '{entry.name}' ({entry.value})"
        elif extensions.names_object(self.name):
            factory, origin = extensions.load_object(self.name, _KIND), self.name
        else:
            return functools.partial(learned_controller, self.name, self.policy)
        if not callable(factory):
            raise ConfigError(
                f"{origin} is a {type(factory).__name__}; give a class, or a function that returns a controller"
            )
        return factory

    @classmethod
    def parse(cls, words: str) -> "ControllerSpec":
        """Build a spec from `NAME` or `NAME=POLICY`, the form used in lists of controllers on the command line."""
        name, equals, policy = words.partition("=")
        named = name in controller_names() or extensions.names_object(name)
        return cls(name, policy) if equals and named else cls(words)

    @property
    def takes_robot(self) -> bool:
        """Whether the controller can be told a robot; a policy cannot, since it has learned one."""
        return _takes(self._factory, "robot")

    def told(self, arena: Arena) -> "ControllerSpec":
        """Return the controller told the robot and the drives of an arena, or the policy `of_robot`.

        Raises:
            ConfigError: if it is a policy for a robot with other joints.
        """
        if not self.takes_robot:
            spec = self.of_robot(arena.robot)
            spec._check_robot(arena.robot)
            return spec
        robot = None if arena.robot == DEFAULT_ROBOT else arena.robot
        drives = None if arena.drives == DEFAULT_DRIVES else arena.drives
        return dataclasses.replace(self, robot=robot, drives=drives)

    def of_robot(self, robot: str) -> "ControllerSpec":
        """Return the learned controller with the shipped policy of a robot, if none is given; any other as it is."""
        own = self.name == "learned" and self.policy is None and robot != DEFAULT_POLICY and robot in shipped_policies()
        return dataclasses.replace(self, policy=robot) if own else self

    @property
    def _known_robot(self) -> Robot:
        """What the controller is told of the robot."""
        return Arena(self.robot or DEFAULT_ROBOT, self.drives or DEFAULT_DRIVES).known_robot

    @property
    def label(self) -> str:
        """Short name for tables: the registered or the controller's own, with the policy, the robot and the drives."""
        name = self.name if self.name in controller_names() else _short(self.name)
        if extensions.names_object(self.name):
            name = _own_name(self, tuple(digest(path.read_bytes()) for path in self.files()))
        policy = None if self.policy is None else _short(self.policy)
        drives = None if self.drives is None else f"{self.drives} drives"
        robot = None if self.robot is None else pathlib.Path(self.robot).stem
        return " ".join(word for word in (name, policy, robot, drives) if word is not None)

    def build(self, robot: Robot | None = None) -> Controller:
        """Build the controller, ready to `reset`.

        Args:
            robot: told to one that takes a robot; None for that of `robot` and `drives`.

        Raises:
            PolicyFileError: if a policy file is missing, damaged or of another version.
        """
        factory, entry = self._factory, plugins().get(self.name)
        told = {"policy": self.policy, "robot": robot or self._known_robot}
        given = {name: value for name, value in told.items() if _takes(factory, name)}
        origin = self.name if entry is None else f"controller '{entry.name}' ({entry.value})"
        try:
            controller = factory(**given)
        except HugwbcError:
            raise
        except Exception as error:  # the code of somebody else may raise anything
            if self.name in _OURS:
                raise
            raise ConfigError(f"{origin} cannot be built: {extensions.described(error)}") from error
        check_controller(controller, origin)
        return controller

    @property
    def is_own(self) -> bool:
        """Whether it is a controller of the user's own, registered or in a Python file."""
        return self.name not in _OURS and (self.name in plugins() or extensions.names_object(self.name))

    @property
    def _is_policy(self) -> bool:
        return not self.is_own and (self.name not in _OURS or self.name == "learned")

    def _check_robot(self, robot: str) -> None:
        """Refuse a robot, by name, that is not the policy's."""
        if self._is_policy:
            from hugwbc.learned.policy.records import check_robot, robot_of

            path, *_ = self.files()
            name = path.parent.name if path.stem in ("policy", "contract") else path.stem
            check_robot(f"policy '{name}'", robot_of(path), robot)

    @property
    def training(self) -> str | None:
        """The paper's kind of arm motion in training; None for a controller that was not trained or does not say.

        Raises:
            PolicyFileError: if a policy file is missing or damaged.
        """
        if not self._is_policy:
            return None
        from hugwbc.learned.policy.records import trained_with

        path, *_ = self.files()
        return None if path.suffix in _CONTRACTS else trained_with(path)

    def identity(self) -> dict[str, Any]:
        """Return what the behaviour depends on, as JSON: name, package, digests of files.

        Equal controllers have equal identities on any machine, because no path is part of it but that of a robot's own
        table.

        Raises:
            PolicyFileError: if one of the files is missing.
        """
        missing = [path for path in self.files() if not path.is_file()]
        if missing:
            raise PolicyFileError(f"there is no policy file {missing[0]}; give the path of one")
        entry = plugins().get(self.name)
        dist = None if entry is None else entry.dist
        package = f"hugwbc {hugwbc.__version__}" if dist is None else f"{dist.name} {dist.version}"
        known = extensions.split_object(self.name)[1] if extensions.names_object(self.name) else "file"
        # A policy that is no path is a word that only a controller of the user's own knows.
        word = (
            None if self.policy is None or not self.is_own or pathlib.Path(self.policy).exists() else str(self.policy)
        )
        robot = {"robot": self.robot or DEFAULT_ROBOT, "drives": self.drives or DEFAULT_DRIVES}
        return {
            "name": self.name if self.name in controller_names() else known,
            "package": package,
            "files": [digest(path.read_bytes()) for path in self.files()],
            "policy": word,
            **(robot if self.takes_robot else {}),
        }

    def files(self) -> list[pathlib.Path]:
        """Return the files that the controller is built from: contract and network, policy, or the user's code."""
        given = None if self.policy is None else pathlib.Path(self.policy)
        if self.is_own:
            entry = plugins().get(self.name)
            source = extensions.source_of(entry) if entry is not None else extensions.split_object(self.name)[0]
            code = [] if source is None else extensions.code_of(source)
            if given is not None and given.is_dir():
                return code + sorted(path for path in given.rglob("*") if path.is_file())
            return code if given is None or not given.is_file() else [*code, given]
        if self.name in _OURS and self.name != "learned":
            return []
        path = policy_file(self.policy or DEFAULT_POLICY if self.name == "learned" else self.name)
        from hugwbc.learned.policy.contract import load_contract
        from hugwbc.learned.policy.network_files import with_weights

        if path.suffix not in _CONTRACTS:
            return with_weights(path)
        network = load_contract(path).policy if given is None or self.name == "learned" else given
        return [path] if network is None else [path, *with_weights(network)]


def _refuse_bare(path: pathlib.Path) -> None:
    """Refuse a network without a contract now, and not when a loop is built."""
    from hugwbc.learned.policy.network_files import ONNX_SUFFIX, TORCHSCRIPT_SUFFIXES

    if path.suffix in TORCHSCRIPT_SUFFIXES:
        raise ConfigError(
            f"{path} is a bare network; write a contract for it as docs/evaluation.md says, and give the contract"
        )
    if path.suffix == ONNX_SUFFIX and path.is_file():
        learned_controller(path)


def _short(name: str | pathlib.Path) -> str:
    """Return what a policy is called in short: a file without its suffix, a folder or a word with all its dots."""
    path = pathlib.Path(name)
    return path.stem if path.is_file() else path.name


@functools.cache
def _own_name(spec: ControllerSpec, code: tuple[str, ...]) -> str:
    """Return the name of a controller of a Python file, whose code has these digests."""
    return spec.build().name


def labels(specs: Sequence[ControllerSpec]) -> list[str]:
    """Return the labels of controllers, those of one name with where they come from."""
    names = [spec.label for spec in specs]
    paths = ["=".join(str(part) for part in (spec.name, spec.policy) if part is not None) for spec in specs]
    found = [name if names.count(name) == 1 else f"{name} ({path})" for name, path in zip(names, paths, strict=True)]
    check_each_once("controllers", found)
    return found


def _takes(factory: Callable[..., Any], parameter: str) -> bool:
    return parameter in inspect.signature(factory).parameters
