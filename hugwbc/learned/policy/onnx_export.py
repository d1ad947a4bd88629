"""Export of a policy to ONNX, for runtimes without torch: written node by node and checked against the policy."""

import dataclasses
import json
import pathlib
from typing import Any

import numpy as np
import torch
from torch import nn

from hugwbc.errors import PolicyFileError, needing
from hugwbc.files import write_whole, writing
from hugwbc.learned.policy.networks import Actor
from hugwbc.learned.policy.policy import LearnedController
from hugwbc.learned.policy.terms import ESTIMATE_SIZE, HISTORY_FRAMES

OPSET = 17
IR_VERSION = 8  # the version that came with this opset; older runtimes refuse newer versions
TOLERANCE = 1e-5  # between torch and the exported file, relative to the larger of 1 and torch's value
_SAMPLES = 64


def export_onnx(controller: LearnedController, path: pathlib.Path) -> float:
    """Write the network of a policy with its contract to an ONNX file, and compare the two.

    Inputs: history and command, as the contract lays them out. Outputs: action, shape (n, joints), and estimate, shape
    (n, 6). Contract and training record are in the file's metadata, as JSON.

    Returns:
        Largest difference between onnxruntime and torch on random inputs; relative where torch's value is above 1.

    Raises:
        PolicyFileError: if the difference exceeds `TOLERANCE`; nothing is written then.
    """
    with needing("export", "ONNX export"):  # an extra that a robot with torch does not need
        import onnx
        import onnxruntime as runtime
    model = _model(onnx, controller.actor)
    for key, content in (("contract", dataclasses.asdict(controller.contract)), ("training", controller.training)):
        entry = model.metadata_props.add()
        entry.key, entry.value = key, json.dumps(content)
    onnx.checker.check_model(model, full_check=True)
    data = model.SerializeToString()
    session = runtime.InferenceSession(data, providers=["CPUExecutionProvider"])
    difference = _difference(session, controller.actor)
    if not difference <= TOLERANCE:
        raise PolicyFileError(
            f"the exported network differs from the policy by {difference:.2g}, valid is {TOLERANCE:g}; "
            "nothing was written. Check that the policy's weights are finite and of ordinary size"
        )
    with writing(path):
        write_whole(path, data)
    return difference


def _model(onnx: Any, actor: Actor) -> Any:  # noqa: ANN401  an optional package
    """Build the graph of `Actor.forward`."""
    helper, kind = onnx.helper, onnx.TensorProto.FLOAT
    nodes, weights = [], []

    def mlp(name: str, layers: nn.Module, source: str, target: str) -> None:
        """Add linear layers and ELUs from one value of the graph to another."""
        modules = list(layers.children())
        for i, layer in enumerate(modules):
            result = target if i == len(modules) - 1 else f"{name}.{i}"
            if isinstance(layer, nn.Linear):
                parts = {"weight": layer.weight, "bias": layer.bias}
                for part, value in parts.items():
                    array = value.detach().numpy()
                    weights.append(onnx.numpy_helper.from_array(array, f"{name}.{i}.{part}"))
                inputs = [source, f"{name}.{i}.weight", f"{name}.{i}.bias"]
                nodes.append(helper.make_node("Gemm", inputs, [result], transB=1))
            else:
                assert isinstance(layer, nn.ELU), layer
                nodes.append(helper.make_node("Elu", [source], [result], alpha=float(layer.alpha)))
            source = result

    def constant(name: str, value: int) -> str:
        weights.append(onnx.numpy_helper.from_array(np.array([value], dtype=np.int64), name))
        return name

    mlp("encoder", actor.encoder, "history", "latent")
    mlp("estimator", actor.estimator, "latent", "estimate")
    ends = [constant("newest_begin", -actor.frame_size), constant("newest_end", 2**31), constant("axis", 1)]
    nodes.append(helper.make_node("Slice", ["history", *ends], ["newest"]))
    nodes.append(helper.make_node("Concat", ["latent", "estimate", "newest", "command"], ["joined"], axis=1))
    mlp("policy", actor.policy, "joined", "action")

    sizes = {"history": HISTORY_FRAMES * actor.frame_size, "command": actor.command_size}
    results = {"action": actor.action_size, "estimate": ESTIMATE_SIZE}
    inputs, outputs = (
        [helper.make_tensor_value_info(name, kind, ["n", size]) for name, size in group.items()]
        for group in (sizes, results)
    )
    graph = helper.make_graph(nodes, "hugwbc_policy", inputs, outputs, weights)
    opset = [helper.make_opsetid("", OPSET)]
    return helper.make_model(graph, opset_imports=opset, ir_version=IR_VERSION, producer_name="hugwbc")


@torch.no_grad()
def _difference(session: Any, actor: Actor) -> float:  # noqa: ANN401  an optional package
    generator = torch.Generator().manual_seed(0)
    history = torch.randn(_SAMPLES, HISTORY_FRAMES * actor.frame_size, generator=generator)
    command = torch.randn(_SAMPLES, actor.command_size, generator=generator)
    found = session.run(["action", "estimate"], {"history": history.numpy(), "command": command.numpy()})
    expected = actor(history, command)
    pairs = [(torch.from_numpy(a), b) for a, b in zip(found, expected, strict=True)]
    return max(float(((a - b).abs() / b.abs().clamp(min=1.0)).max()) for a, b in pairs)
