"""Network files as functions of the observation: TorchScript run by torch, and ONNX run by onnxruntime.

Neither is unpickled. A TorchScript file nevertheless contains a program, which runs with the rights of the user.
"""

import pathlib
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from hugwbc.errors import PolicyFileError
from hugwbc.learned.policy.onnx_policy import onnx_session

TORCHSCRIPT_SUFFIXES = (".pt", ".pth", ".ts", ".jit")
SUFFIXES = (*TORCHSCRIPT_SUFFIXES, ".onnx")
# Methods that exporters add to clear the recurrent state; legged_gym and rsl_rl use the first.
_RESETS = ("reset_memory", "reset")


class Network(Protocol):
    """A network for one robot, with or without memory."""

    def reset(self) -> None:
        """Forget the past."""
        ...

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Return the actions, shape (m,), for an input of shape (n,)."""
        ...


def load_network(path: pathlib.Path, state: Sequence[tuple[str, str]] = ()) -> Network:
    """Load the network of a file.

    Args:
        path: TorchScript (`SUFFIXES`) or ONNX (.onnx).
        state: for an ONNX network, names of the state inputs and of the outputs with their next values.

    Raises:
        PolicyFileError: if the file is missing, of another kind or cannot be read.
    """
    if not path.is_file():
        raise PolicyFileError(f"there is no policy file {path}; give the path of a {', '.join(SUFFIXES)} file")
    if path.suffix in TORCHSCRIPT_SUFFIXES:
        if state:
            raise PolicyFileError(f"{path} is TorchScript, which keeps its state itself; leave out the field state")
        return TorchScriptNetwork(path)
    if path.suffix == ".onnx":
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

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Return the actions, shape (m,), for an input of shape (n,)."""
        torch = self._torch
        with torch.no_grad():
            output = self._module(torch.as_tensor(observation, dtype=torch.float32)[None])
        # Exported actor-critics return more than the actions, which come first.
        action = output[0] if isinstance(output, tuple | list) else output
        return action.reshape(-1).double().numpy()


class OnnxNetwork:
    """An ONNX network; a recurrent state goes through its inputs and outputs and starts at zero."""

    def __init__(self, path: pathlib.Path, state: Sequence[tuple[str, str]] = ()) -> None:
        self._session: Any = onnx_session(path)
        self._inputs = {node.name: node for node in self._session.get_inputs()}
        outputs = [node.name for node in self._session.get_outputs()]
        self._state = tuple(state)
        observations = [name for name in self._inputs if name not in dict(state)]
        actions = [name for name in outputs if name not in dict(state).values()]
        missing = [name for name in dict(state) if name not in self._inputs]
        missing += [name for name in dict(state).values() if name not in outputs]
        if missing or len(observations) != 1 or not actions:
            raise PolicyFileError(
                f"{path} has the inputs {', '.join(self._inputs)} and the outputs {', '.join(outputs)}; name in the "
                "field state every input but the observation, with the output that gives its next value "
                f"({', '.join(missing) or 'some'} {'is' if missing else 'are'} missing)"
            )
        self._observation, self._action = observations[0], actions[0]
        self.reset()

    def reset(self) -> None:
        """Set the recurrent state to zero."""
        self._values = {name: self._zeros(name) for name, _ in self._state}

    def _zeros(self, name: str) -> np.ndarray:
        # A free dimension is the batch, which is one robot.
        return np.zeros([size if isinstance(size, int) else 1 for size in self._inputs[name].shape], np.float32)

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Return the actions, shape (m,), for an input of shape (n,)."""
        given = {self._observation: observation.astype(np.float32)[None], **self._values}
        action, *states = self._session.run([self._action, *(output for _, output in self._state)], given)
        self._values = {name: value for (name, _), value in zip(self._state, states, strict=True)}
        return np.asarray(action, dtype=float).reshape(-1)
