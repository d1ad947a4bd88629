"""Networks as functions of arrays: ours run by torch, TorchScript run by torch, and ONNX run by onnxruntime.

None is unpickled. A TorchScript file nevertheless contains a program, which runs with the rights of the user.
"""

import importlib
import json
import pathlib
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np

from hugwbc.errors import PolicyFileError, needing

TORCHSCRIPT_SUFFIXES = (".pt", ".pth", ".ts", ".jit")
ONNX_SUFFIX = ".onnx"
SUFFIXES = (*TORCHSCRIPT_SUFFIXES, ONNX_SUFFIX)
# Methods that exporters add to clear the recurrent state; legged_gym and rsl_rl use the first.
_RESETS = ("reset_memory", "reset")


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
    if path.suffix in TORCHSCRIPT_SUFFIXES:
        if state:
            raise PolicyFileError(f"{path} is TorchScript, which keeps its state itself; leave out the field state")
        return TorchScriptNetwork(path)
    if path.suffix == ONNX_SUFFIX:
        return OnnxNetwork(path, state)
    raise PolicyFileError(f"{path} ends in '{path.suffix}'; valid is TorchScript or ONNX: {', '.join(SUFFIXES)}")


class TorchScriptNetwork:
    """A scripted or traced module; it may keep a recurrent state in its buffers, as legged_gym's exporter does."""

    def __init__(self, path: pathlib.Path) -> None:
        import torch

        torch.set_num_threads(1)  # more threads only cost time for one robot
        self._torch = torch
        try:
            self._module: Any = torch.jit.load(str(path), map_location="cpu").eval()
        except (RuntimeError, ValueError, OSError) as error:
            reason = str(error).strip().splitlines()[0]
            raise PolicyFileError(
                f"{path} is not a TorchScript file ({reason}); write it with torch.jit.script(module).save(path). "
                "A checkpoint written by torch.save is a pickle and is not loaded"
            ) from error
        self._start = {name: buffer.clone() for name, buffer in self._module.named_buffers()}

    def reset(self) -> None:
        """Restore all buffers from the file, and then call the module's own reset if it has one."""
        with self._torch.no_grad():
            for name, buffer in self._module.named_buffers():
                buffer.copy_(self._start[name])
            for name in _RESETS:
                if hasattr(self._module, name):
                    getattr(self._module, name)()
                    return

    def __call__(self, inputs: Sequence[np.ndarray]) -> np.ndarray:
        """Return the actions, shape (m,)."""
        with self._torch.no_grad():
            output = self._module(*(self._torch.from_numpy(row)[None] for row in inputs))
        # Exported actor-critics return more than the actions, which come first.
        action = output[0] if isinstance(output, tuple | list) else output
        return action.reshape(-1).double().numpy()


class OnnxNetwork:
    """An ONNX network; a recurrent state goes through its inputs and outputs and starts at zero.

    Attributes:
        metadata: what `hugwbc export` wrote besides the network; empty for other files.
    """

    def __init__(self, path: pathlib.Path, state: Mapping[str, str]) -> None:
        self._session = _session(path)
        self.metadata = _metadata(self._session, path)
        self._shapes = {node.name: node.shape for node in self._session.get_inputs()}
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
        self._action = actions[0]
        self.reset()

    def reset(self) -> None:
        """Set the recurrent state to zero."""
        self._values = {name: self._zeros(name) for name in self._state}

    def _zeros(self, name: str) -> np.ndarray:
        # A free dimension is the batch, which is one robot.
        return np.zeros([size if isinstance(size, int) else 1 for size in self._shapes[name]], np.float32)

    def __call__(self, inputs: Sequence[np.ndarray]) -> np.ndarray:
        """Return the actions, shape (m,)."""
        given = {name: row[None] for name, row in zip(self._observed, inputs, strict=True)}
        action, *states = self._session.run([self._action, *self._state.values()], {**given, **self._values})
        self._values = dict(zip(self._state, states, strict=True))
        return np.asarray(action, dtype=float).reshape(-1)


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
    entries = session.get_modelmeta().custom_metadata_map
    try:
        return {name: json.loads(entries[name]) for name in ("contract", "training") if name in entries}
    except (ValueError, RecursionError) as error:  # brackets nested by the thousand
        raise PolicyFileError(f"the contract in {path} is not JSON ({error}); export the policy again") from error
