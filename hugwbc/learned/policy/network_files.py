"""Files of policies: where they are, and their networks as functions of arrays, run by torch or onnxruntime.

No network is unpickled. A TorchScript file nevertheless contains a program, which runs with the rights of the user.
"""

import importlib
import io
import json
import os
import pathlib
import re
import threading
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np

from hugwbc.errors import PolicyFileError, UnknownNameError, needing
from hugwbc.files import note, read_file
from hugwbc.robot_tables import models_dir

DEFAULT_POLICY = "h1"
POLICY_FILE, SNAPSHOT_FILE, CONTRACT_FILE = "policy.safetensors", "snapshot.safetensors", "contract.yaml"
LARGEST_FILE = 2_000_000_000  # [byte]
TORCHSCRIPT_SUFFIXES = (".pt", ".pth", ".ts", ".jit")
ONNX_SUFFIX = ".onnx"
SUFFIXES = (*TORCHSCRIPT_SUFFIXES, ONNX_SUFFIX)
# Types of ONNX inputs to which an observation can be converted.
_TYPES = {"tensor(float)": np.float32, "tensor(double)": np.float64, "tensor(float16)": np.float16}
# Methods that exporters add to clear the recurrent state; legged_gym and rsl_rl use the first.
_RESETS = ("reset_memory", "reset")


def shipped_policies() -> list[str]:
    """Return the names of the shipped policies, of all robots."""
    return [path.parent.name for path in _shipped(POLICY_FILE)]


def shipped_contracts() -> list[str]:
    """Return the names of the shipped contracts of other projects' policies, whose networks are not shipped."""
    return [path.parent.name for path in _shipped(CONTRACT_FILE)]


def _shipped(file: str) -> list[pathlib.Path]:
    """Return the files of a given name in the folders of the shipped policies, sorted by folder."""
    return sorted(models_dir().glob(f"*/policies/*/{file}"), key=lambda path: path.parent.name)


def policy_file(name_or_path: str | pathlib.Path = DEFAULT_POLICY) -> pathlib.Path:
    """Find the file of a policy or contract, given a shipped name, a file, or a folder that holds one.

    A shipped name means what is shipped, even if a folder has that name; `./NAME` or a `pathlib.Path` means the folder.

    Raises:
        UnknownNameError: if there is neither a shipped policy of this name nor such a path.
    """
    path = pathlib.Path(name_or_path)
    shipped = {file.parent.name: file for file in (*_shipped(POLICY_FILE), *_shipped(CONTRACT_FILE))}
    if isinstance(name_or_path, str) and name_or_path in shipped:
        return shipped[name_or_path]
    # pathlib raises on a name that no file can have; os.path says that it does not exist.
    if os.path.exists(path):
        contract = path / CONTRACT_FILE
        return path if not path.is_dir() else contract if contract.is_file() else path / POLICY_FILE
    if str(name_or_path) in shipped:
        return shipped[str(name_or_path)]
    valid = [*shipped_policies(), *shipped_contracts(), "the path of a policy, of a contract, or of a folder with one"]
    raise UnknownNameError("policy", name_or_path, valid)


def read_header(path: pathlib.Path) -> dict[str, str]:
    """Return the metadata of a safetensors file."""
    try:
        return header_of(read_file(path, LARGEST_FILE))
    except (OSError, ValueError, AttributeError, TypeError, RecursionError) as error:
        raise PolicyFileError(f"{path} is not a readable safetensors file ({error}); copy it again") from error


def from_json(text: str, path: pathlib.Path) -> Any:  # noqa: ANN401  what a file holds
    """Return the content of a file's metadata, which are JSON; raise PolicyFileError if they are not."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:  # brackets nested by the thousand
        raise PolicyFileError(f"{path} is corrupted: its metadata is not JSON ({error}). Copy it again") from error


def header_of(data: bytes) -> dict[str, str]:
    """Return the metadata of a safetensors file, in which an 8-byte length and a JSON header precede the tensors."""
    length = int.from_bytes(data[:8], "little")
    return dict(json.loads(data[8 : 8 + length]).get("__metadata__", {}))


class Network(Protocol):
    """A network for one robot, with or without memory."""

    def reset(self) -> None:
        """Forget the past."""
        ...

    def __call__(self, inputs: Sequence[np.ndarray]) -> np.ndarray:
        """Return the actions, shape (m,), for the contract's one or two inputs, shape (n,) each, float32."""
        ...


def load_network(path: pathlib.Path, state: Mapping[str, str]) -> Network:
    """Load the network of a file.

    Args:
        path: TorchScript or ONNX (`SUFFIXES`).
        state: for an ONNX network, names of the state inputs and of the outputs with their next values.
    """
    if not path.is_file():
        raise PolicyFileError(f"there is no policy file {path}; give the path of a {', '.join(SUFFIXES)} file")
    for file in with_weights(path):
        note(file)
    if path.suffix in TORCHSCRIPT_SUFFIXES:
        if state:
            raise PolicyFileError(f"{path} is TorchScript, which keeps its state itself; leave out the field state")
        return TorchScriptNetwork(path)
    if path.suffix == ONNX_SUFFIX:
        return OnnxNetwork(path, state)
    raise PolicyFileError(f"{path} ends in '{path.suffix}'; valid is TorchScript or ONNX: {', '.join(SUFFIXES)}")


def with_weights(path: pathlib.Path) -> list[pathlib.Path]:
    """Return a network's file, and the files beside it that an ONNX file names for its weights."""
    content = path.read_bytes() if path.suffix == ONNX_SUFFIX and path.is_file() else b""
    # Fields 1 and 2 of a StringStringEntryProto of ONNX: the key "location", and a length and the value.
    ends = [match.end() for match in re.finditer(rb"\x0a\x08location\x12", content)]
    names = {content[end + 1 : end + 1 + content[end]].decode(errors="replace") for end in ends}
    return [path, *(path.parent / name for name in sorted(names) if (path.parent / name).is_file())]


_here = threading.local()


def keep_threads(count: int | None) -> None:
    """Let torch use so many threads in this thread; None leaves torch's own choice.

    The linear algebra below torch does not apply an earlier `torch.set_num_threads` in a thread that begins later:
    there, beside a busy core, a tick of 0.1 ms took 15 ms.
    """
    if count is not None and getattr(_here, "count", None) != count:
        import torch

        _here.count = count
        torch.set_num_threads(count)


class TorchScriptNetwork:
    """A scripted or traced module; it may keep a recurrent state, as legged_gym's do, and overwrite its inputs.

    Attributes:
        action: name or number of the output that holds the actions.
    """

    def __init__(self, path: pathlib.Path) -> None:
        import torch

        self._torch, self.action, self._file = torch, "0", path.read_bytes()
        try:
            self._load()
        except (RuntimeError, ValueError, OSError) as error:
            reason = str(error).strip().splitlines()[0]
            raise PolicyFileError(
                f"{path} is not a TorchScript file ({reason}); write it with torch.jit.script(module).save(path). "
                "A checkpoint written by torch.save is a pickle and is not loaded"
            ) from error
        parameters = self._module.parameters()
        self._dtype = next((p.dtype for p in parameters if p.is_floating_point()), torch.float32)

    def _load(self) -> None:
        self._module: Any = self._torch.jit.load(io.BytesIO(self._file), map_location="cpu").eval()

    def reset(self) -> None:
        """Load the module anew, so that all of its state is that of the file, and call its own reset if it has one."""
        self._load()
        with self._torch.no_grad():
            for name in _RESETS:
                if hasattr(self._module, name):
                    getattr(self._module, name)()
                    return

    def __call__(self, inputs: Sequence[np.ndarray]) -> np.ndarray:
        """Return the actions, shape (m,)."""
        return self.outputs(inputs)[self.action]

    def outputs(self, inputs: Sequence[np.ndarray]) -> dict[str, np.ndarray]:
        """Return all outputs by name, flat; the outputs of a tuple have their numbers as names."""
        keep_threads(1)
        with self._torch.no_grad():
            found: Any = self._module(*(self._torch.tensor(row, dtype=self._dtype)[None] for row in inputs))
        if not isinstance(found, dict):
            parts = found if isinstance(found, tuple | list) else (found,)
            found = dict(zip(getattr(found, "_fields", map(str, range(len(parts)))), parts, strict=True))
        tensors = {name: part for name, part in found.items() if isinstance(part, self._torch.Tensor)}
        return {str(name): part.reshape(-1).double().numpy() for name, part in tensors.items()}


class OnnxNetwork:
    """An ONNX network; a recurrent state goes through its inputs and outputs and starts at zero.

    Attributes:
        metadata: what `hugwbc export` wrote besides the network; empty for other files.
        action: name of the output that holds the actions.
    """

    def __init__(self, path: pathlib.Path, state: Mapping[str, str]) -> None:
        self._session, self._path = _session(path), path
        self.metadata = _metadata(self._session, path)
        nodes = self._session.get_inputs()
        self._shapes = {node.name: node.shape for node in nodes}
        self._types = {node.name: _TYPES.get(node.type, np.float32) for node in nodes}
        outputs = [node.name for node in self._session.get_outputs()]
        self._state = dict(state)
        self._observed = [name for name in self._shapes if name not in state]
        actions = [name for name in outputs if name not in state.values()]
        missing = [name for name in state if name not in self._shapes]
        missing += [name for name in state.values() if name not in outputs]
        if missing or not self._observed or not actions:
            raise PolicyFileError(
                f"{path} has the inputs {', '.join(self._shapes)} and the outputs {', '.join(outputs)}; name in the "
                "field state every input but the observation, with the output that gives its next value "
                f"({', '.join(missing) or 'some'} {'is' if missing else 'are'} missing)"
            )
        self.action, self._actions = actions[0], actions
        for node in nodes:
            batch = node.shape[:-1]
            one_robot = node.name in state or (len(batch) <= 1 and not any(isinstance(n, int) and n > 1 for n in batch))
            if not one_robot or node.type not in _TYPES:
                raise PolicyFileError(
                    f"{path} reads {node.name} as {node.type} of shape {node.shape}; export it for one robot, of shape "
                    f"(1, numbers) or with a free first size, as {', '.join(_TYPES)}"
                )
        self.reset()

    def reset(self) -> None:
        """Set the recurrent state to zero."""
        # A free dimension is the batch, which is one robot.
        shapes = {name: [size if isinstance(size, int) else 1 for size in self._shapes[name]] for name in self._state}
        self._values = {name: np.zeros(shape, self._types[name]) for name, shape in shapes.items()}

    def __call__(self, inputs: Sequence[np.ndarray]) -> np.ndarray:
        """Return the actions, shape (m,)."""
        (action,) = self._run([self.action], inputs)
        return action

    def outputs(self, inputs: Sequence[np.ndarray]) -> dict[str, np.ndarray]:
        """Return all outputs but the recurrent state by name, flat."""
        return dict(zip(self._actions, self._run(self._actions, inputs), strict=True))

    def _run(self, names: Sequence[str], inputs: Sequence[np.ndarray]) -> list[np.ndarray]:
        if len(inputs) != len(self._observed):
            raise PolicyFileError(
                f"{self._path} reads {', '.join(self._observed)}, and the contract gives {len(inputs)} of them: the "
                "terms of observation, then those of command, which is a second input. Name recurrent ones in state; "
                "others cannot be given, so export the network without them"
            )
        given = {
            name: (row if len(self._shapes[name]) == 1 else row[None]).astype(self._types[name], copy=False)
            for name, row in zip(self._observed, inputs, strict=True)
        }
        found = self._session.run([*names, *self._state.values()], {**given, **self._values})
        self._values = dict(zip(self._state, found[len(names) :], strict=True))
        return [np.asarray(part, dtype=float).reshape(-1) for part in found[: len(names)]]


def _session(path: pathlib.Path) -> Any:  # noqa: ANN401  an optional package
    with needing("export", str(path)):
        onnxruntime: Any = importlib.import_module("onnxruntime")
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    try:
        return onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's errors share no class but Exception
        reason = str(error).strip().splitlines()[0]
        raise PolicyFileError(f"{path} is not an ONNX network that onnxruntime can run ({reason})") from error


def _metadata(session: Any, path: pathlib.Path) -> dict[str, Any]:  # noqa: ANN401  an optional package
    found, entries = {}, session.get_modelmeta().custom_metadata_map
    for name in {"contract", "training"} & set(entries):
        try:
            found[name] = json.loads(entries[name])
        except (ValueError, RecursionError) as error:  # brackets nested by the thousand
            if name == "contract":  # another project may use the entry training in any way
                what = f"the contract in {path} is not JSON ({error})"
                raise PolicyFileError(f"{what}; export the policy again") from error
    return found
