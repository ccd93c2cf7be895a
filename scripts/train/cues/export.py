"""Writes the head as ONNX and its manifest; reads a head back.

The graph has one input `embeddings` float32[1, 8, 96] and one output `probabilities` float32[1, 6], and nothing but
Sub, Div, Clip, Transpose, Conv, Relu, Flatten, Gemm and Softmax. Its weights are initializers inside the file under the
names of network.SHAPES, raw little-endian: enrolment finds dense1 and dense2 by name and puts new ones in their place.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

import network
from features import EMBEDDING, WINDOWS
from network import Weights
from rules import DIRECTIONS, STARTS, Rules
from words import LABELS

OPSET, IR_VERSION = 13, 8


def model(weights: Weights) -> onnx.ModelProto:
    node = helper.make_node
    nodes = [
        node("Sub", ["embeddings", "mean"], ["centred"]),
        node("Div", ["centred", "deviation"], ["scaled"]),
        node("Clip", ["scaled", "clamp_min", "clamp_max"], ["clamped"]),
        node("Transpose", ["clamped"], ["channels"], perm=[0, 2, 1]),
        node("Conv", ["channels", "conv1.weight", "conv1.bias"], ["made1"], kernel_shape=[network.KERNEL]),
        node("Relu", ["made1"], ["made1_relu"]),
        node("Conv", ["made1_relu", "conv2.weight", "conv2.bias"], ["made2"], kernel_shape=[network.KERNEL]),
        node("Relu", ["made2"], ["made2_relu"]),
        node("Flatten", ["made2_relu"], ["flat"], axis=1),
        node("Gemm", ["flat", "dense1.weight", "dense1.bias"], ["hidden"], transB=1),
        node("Relu", ["hidden"], ["hidden_relu"]),
        node("Gemm", ["hidden_relu", "dense2.weight", "dense2.bias"], ["logits"], transB=1),
        node("Softmax", ["logits"], ["probabilities"], axis=1),
    ]
    initializers = [
        numpy_helper.from_array(np.array(-network.CLAMP, np.float32), "clamp_min"),
        numpy_helper.from_array(np.array(network.CLAMP, np.float32), "clamp_max"),
    ]
    for name in ("mean", "deviation", *network.SHAPES):
        initializers.append(numpy_helper.from_array(np.ascontiguousarray(weights[name], np.float32), name))
    graph = helper.make_graph(
        nodes,
        "cues",
        [helper.make_tensor_value_info("embeddings", TensorProto.FLOAT, [1, WINDOWS, EMBEDDING])],
        [helper.make_tensor_value_info("probabilities", TensorProto.FLOAT, [1, len(LABELS)])],
        initializers,
    )
    made = helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=IR_VERSION)
    made.producer_name = "guidedog"
    onnx.checker.check_model(made, full_check=True)
    return made


def read(path: Path) -> Weights:
    """The weights of a head that `model` made."""
    stored = {tensor.name: numpy_helper.to_array(tensor) for tensor in onnx.load(path).graph.initializer}
    return {name: stored[name].copy() for name in ("mean", "deviation", *network.SHAPES)}


def sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def toml(value: Any) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {toml(v)}" for key, v in value.items()) + " }"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(toml, value)) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    return f"{value:g}" if isinstance(value, float) else str(value)


def duration(seconds: float) -> str:
    return f"{round(seconds * 1000)}ms"


def rules_table(rules: Rules) -> dict[str, Any]:
    return {
        "stop": {"threshold": rules.stop, "steps": rules.stop_steps},
        "direction": {
            "threshold": dict(zip(DIRECTIONS, rules.directions)),
            "steps": rules.direction_steps,
            "isolated": rules.isolated,
        },
        "start": dict(zip(STARTS, rules.starts)),
        "refractory": duration(rules.refractory_s),
        "isolation": {
            "quiet": duration(rules.quiet_s),
            "segment_max": duration(rules.segment_max_s),
            "wait_max": duration(rules.wait_max_s),
            "reach": duration(rules.reach_s),
            "margin_db": rules.margin_db,
            "depth_db": rules.depth_db,
            "floor_rise_db": rules.floor_rise_db,
            "floor_fall": rules.floor_fall,
        },
        "voice": {
            "periodicity": rules.periodicity,
            "voiced": duration(rules.voiced_s),
            "above_floor_db": rules.above_floor_db,
        },
        "talk": {
            "reach": duration(rules.talk_s),
            "voiced": duration(rules.talk_voiced_s),
            "depth_db": rules.talk_depth_db,
            "stop": {"threshold": rules.talk_stop, "steps": rules.talk_stop_steps},
        },
    }
