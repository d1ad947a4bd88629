"""A policy that `hugwbc export` wrote, run by onnxruntime without torch: the contract is in the file's metadata."""

import importlib
import json
import pathlib
from typing import Any

import numpy as np

from hugwbc.errors import PolicyFileError
from hugwbc.learned.policy import layout
from hugwbc.learned.policy.network_policy import NetworkPolicy
from hugwbc.learned.policy.policy_contract import command_size, complete_contract, recorded_intervention

SUFFIX = ".onnx"
CONTRACT_KEY = "contract"  # of the metadata


def load_onnx_policy(path: str | pathlib.Path) -> NetworkPolicy:
    """Load an exported policy as a controller; its joint targets are those of the policy, up to rounding.

    Raises:
        PolicyFileError: if the file is missing or no ONNX network, onnxruntime is not installed, or the contract is
            missing, malformed or does not fit the network.
    """
    session = _session(pathlib.Path(path))
    metadata = complete_contract(_contract(session, path), path)
    _check_shapes(session, metadata, path)

    def network(history: np.ndarray, command: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        action, estimate = session.run(["action", "estimate"], {"history": history, "command": command})
        return action, estimate

    return NetworkPolicy(network, metadata)


def trained_with(path: str | pathlib.Path) -> str | None:
    """Return what moved the arms in the training of an exported policy; None without a record.

    Raises:
        PolicyFileError: as `load_onnx_policy`.
    """
    return recorded_intervention(_contract(_session(pathlib.Path(path)), path))


def _session(path: pathlib.Path) -> Any:  # noqa: ANN401  an optional package
    if not path.is_file():
        raise PolicyFileError(f"there is no policy file {path}; give the path of one that `hugwbc export` wrote")
    return onnx_session(path)


def onnx_session(path: pathlib.Path) -> Any:  # noqa: ANN401  an optional package
    """Return a session of onnxruntime, on one thread, for any ONNX file.

    Raises:
        PolicyFileError: if onnxruntime is not installed, or cannot run the file.
    """
    try:
        onnxruntime: Any = importlib.import_module("onnxruntime")
    except ImportError as error:
        raise PolicyFileError(f"{path} needs onnxruntime; run `pip install 'hugwbc[export]'`") from error
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    try:
        return onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's errors share no class but Exception
        reason = str(error).strip().splitlines()[0]
        raise PolicyFileError(f"{path} is not an ONNX network that onnxruntime can run ({reason})") from error


def _contract(session: Any, path: str | pathlib.Path) -> dict[str, Any]:  # noqa: ANN401  an optional package
    text = session.get_modelmeta().custom_metadata_map.get(CONTRACT_KEY)
    if text is None:
        raise PolicyFileError(
            f"{path} is a bare network: it has no contract of `hugwbc export`. Write a contract for it as "
            "docs/evaluation.md says, and give the contract"
        )
    try:
        metadata = json.loads(text)
    except (ValueError, RecursionError) as error:  # brackets nested by the thousand
        raise PolicyFileError(f"the contract in {path} is not JSON ({error}); export the policy again") from error
    if not isinstance(metadata, dict):
        raise PolicyFileError(f"the contract in {path} is not a JSON object; export the policy again")
    return metadata


def _check_shapes(session: Any, metadata: dict[str, Any], path: str | pathlib.Path) -> None:  # noqa: ANN401
    """Refuse a network whose inputs and outputs are not those of its contract."""
    found = {node.name: node.shape[-1] for node in (*session.get_inputs(), *session.get_outputs())}
    expected = {
        "history": layout.HISTORY_FRAMES * layout.PROPRIOCEPTION_SIZE,
        "command": command_size(metadata),
        "action": layout.ACTION_SIZE,
        "estimate": layout.ESTIMATE_SIZE,
    }
    if found != expected:
        raise PolicyFileError(
            f"{path} has inputs and outputs of the sizes {found}, its contract asks for {expected}; export the policy "
            "again"
        )
