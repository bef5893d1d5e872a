"""Export of a learned policy as an ONNX graph, for programs without this package and torch.

    training.export_onnx("runs/mine/best", "mine.onnx")

The graph maps a robot's row of the observation, as the environment returns it and without further normalisation, to its
action in [-1, 1]. A policy with a base has a second input, `base_action`: the graph contains the network and the sum,
but not the classical policy, which is a program with a state (such as a model predictive controller). The metadata
contain the names of the inputs' entries, the scenario and the base.
"""

import importlib
import json
from pathlib import Path
from typing import Any

import numpy as np

from lissajous_env import Scenario
from lissajous_env.plugins import missing
from lissajous_env.storage.files import replacing
from lissajous_env.world.observation import layout
from training.learned import checkpoint
from training.learned.card import Card, constants_of
from training.learned.network import Network
from training.learned.policy import Learned, find

_OPSET = 17
"""Version of the operators, which runtimes support since 2022."""


def export_onnx(policy: Learned | str | Path, path: str | Path, scenario: Scenario | None = None) -> None:
    """Write a learned policy as an ONNX file.

    Inputs are `observation` (rows, D), float32, as in `layout(scenario)`, and, if the policy has a base, `base_action`
    (rows, action_size), the base's actions for the same rows; the output is `action` (rows, action_size).

    Args:
        policy: Policy, name of an included one, or folder of a checkpoint.
        path: File to write.
        scenario: Scenario of the observation; by default that of the policy, or of its training.

    Raises:
        MissingExtraError: the extra `onnx` is not installed.
        ValueError: there is no such policy, or it does not fit the scenario.
    """
    try:
        importlib.import_module("onnx")
    except ImportError as error:
        raise missing("export_onnx", "onnx", error) from error
    if isinstance(policy, Learned):
        network, card, made = policy.network, policy.card, scenario or policy.scenario
    else:
        network, card, _ = checkpoint.read(find(policy))
        made = scenario or checkpoint.home_scenario(card)
    if not isinstance(network, Network):
        rule = "must have a network that reads entries of an observation to be exported"
        raise ValueError(f"policy {rule}, got {policy}, whose network reads sets")
    graph = _model(network, card, made).SerializeToString()
    with replacing(path) as temporary:
        Path(temporary).write_bytes(graph)


def _model(network: Network, card: Card, scenario: Scenario) -> Any:
    from onnx import TensorProto, checker, helper, numpy_helper

    columns, names = card.columns(scenario), layout(scenario).names
    if card.constants:
        network = network.with_constants(len(card.inputs), constants_of(scenario, card.constants))
    held = {"columns": columns.astype(np.int64), "low": np.float32(-1), "high": np.float32(1)}
    inputs = [helper.make_tensor_value_info("observation", TensorProto.FLOAT, ["rows", len(names)])]
    nodes = [helper.make_node("Gather", ["observation", "columns"], ["entries"], axis=1)]
    last = "entries"
    if card.base is not None:
        inputs.append(helper.make_tensor_value_info("base_action", TensorProto.FLOAT, ["rows", card.action_size]))
        nodes.append(helper.make_node("Concat", ["entries", "base_action"], ["input"], axis=1))
        last = "input"
    for k, (weight, bias) in enumerate(zip(network.weights, network.biases, strict=True)):
        held |= {f"weight_{k}": weight, f"bias_{k}": bias}
        nodes.append(helper.make_node("Gemm", [last, f"weight_{k}", f"bias_{k}"], [f"sum_{k}"], transB=1))
        last = f"sum_{k}"
        if k < len(network.weights) - 1:
            nodes.append(helper.make_node("Relu", [last], [f"layer_{k}"]))
            last = f"layer_{k}"
    own = "action" if card.base is None else "own"
    nodes.append(helper.make_node("Clip", [last, "low", "high"], [own]))
    if card.base is not None:
        held["residual"] = np.float32(card.residual)
        nodes += [
            helper.make_node("Mul", [own, "residual"], ["added"]),
            helper.make_node("Add", ["base_action", "added"], ["sum"]),
            helper.make_node("Clip", ["sum", "low", "high"], ["action"]),
        ]
    output = helper.make_tensor_value_info("action", TensorProto.FLOAT, ["rows", card.action_size])
    tensors = [numpy_helper.from_array(np.asarray(array), name) for name, array in held.items()]
    graph = helper.make_graph(nodes, f"policy of {card.scenario}", inputs, [output], tensors)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", _OPSET)], ir_version=8)
    about = {"scenario": card.scenario, "robots": card.kind, "base": card.base or "none"}
    if card.base_parameters:
        about["base_parameters"] = json.dumps(dict(card.base_parameters))
    helper.set_model_props(model, about | {"observation": json.dumps(names)})
    checker.check_model(model)
    return model
