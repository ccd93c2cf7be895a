"""The embedding: its layers, and ONNX graphs of it, over a whole stretch at once or a step at a time.

It is Google's speech embedding, whose layers have no padding in time: an embedding is of 76 frames, and each 8 frames
there is another. Step by step, each layer that looks back keeps the last two rows of what it saw: `memory`. A step
then looks at 8 frames, not at 76 again, and gives the same numbers.

Weights are numpy arrays by the names that torch gives them: `layers.N.weight` float32[out, in, time, bands], and
`layers.N.bias`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from features import BANDS, EMBEDDING, STEP_FRAMES

OPSET, IR_VERSION = 13, 8
SLOPE, LEAST = 0.2, -0.4


class Conv(NamedTuple):
    channels: int
    time: int
    bands: int  # as wide as it sees; padded, so that there are as many bands after it
    last: bool = False  # without a bias, and nothing follows


class Pool(NamedTuple):
    time: int
    bands: int


def block(channels: int) -> tuple[Conv, ...]:
    return 2 * (Conv(channels, 1, 3), Conv(channels, 3, 1))


LAYERS: tuple[Conv | Pool, ...] = (
    Conv(24, 3, 3), Conv(24, 1, 3), Conv(24, 3, 1), Pool(2, 2), *block(48), Pool(1, 2), *block(72), Pool(2, 2),
    *block(96), Pool(1, 2), *block(96), Pool(2, 2), Conv(EMBEDDING, 3, 1, last=True),
)  # fmt: skip

Weights = dict[str, np.ndarray]


def places() -> list[int]:
    """Where each layer stands in torch's sequence: after a convolution come two that have no weights."""
    at, made = 0, []
    for layer in LAYERS:
        made.append(at)
        at += 3 if isinstance(layer, Conv) else 1
    return made


def memory_numbers() -> int:
    """How many numbers a step hands to the next."""
    channels, bands, count = 1, BANDS, 0
    for layer in LAYERS:
        if isinstance(layer, Conv):
            count += (layer.time - 1) * channels * bands
            channels = layer.channels
        else:
            bands //= layer.bands
    return count


class Graph:
    """Collects nodes and constants."""

    def __init__(self) -> None:
        self.nodes: list[onnx.NodeProto] = []
        self.constants: list[onnx.TensorProto] = []

    def constant(self, value: np.ndarray, name: str = "") -> str:
        name = name or f"constant{len(self.constants)}"
        self.constants.append(numpy_helper.from_array(np.ascontiguousarray(value), name))
        return name

    def node(self, kind: str, inputs: list[str], **attributes: object) -> str:
        made = f"{kind.lower()}{len(self.nodes)}"
        self.nodes.append(helper.make_node(kind, inputs, [made], **attributes))
        return made

    def sliced(self, x: str, start: int, end: int, axis: int) -> str:
        numbers = (self.constant(np.array([n], np.int64)) for n in (start, end, axis))
        return self.node("Slice", [x, *numbers])

    def reshaped(self, x: str, shape: tuple[int, ...]) -> str:
        return self.node("Reshape", [x, self.constant(np.array(shape, np.int64))])

    def convolved(self, x: str, layer: Conv, place: int, weights: Weights) -> str:
        name = f"layers.{place}"
        inputs = [x, self.constant(weights[f"{name}.weight"].astype(np.float32), f"{name}.weight")]
        if not layer.last:
            inputs.append(self.constant(weights[f"{name}.bias"].astype(np.float32), f"{name}.bias"))
        sides = layer.bands // 2
        x = self.node("Conv", inputs, kernel_shape=[layer.time, layer.bands], pads=[0, sides, 0, sides])
        if layer.last:
            return x
        x = self.node("LeakyRelu", [x], alpha=SLOPE)
        return self.node("Max", [x, self.constant(np.full((1, 1, 1, 1), LEAST, np.float32))])

    def pooled(self, x: str, layer: Pool) -> str:
        size = [layer.time, layer.bands]
        return self.node("MaxPool", [x], kernel_shape=size, strides=size)

    def model(self, name: str, inputs: list[tuple[str, list]], outputs: list[tuple[str, list]]) -> onnx.ModelProto:
        shaped = lambda these: [helper.make_tensor_value_info(n, TensorProto.FLOAT, shape) for n, shape in these]
        graph = helper.make_graph(self.nodes, name, shaped(inputs), shaped(outputs), self.constants)
        made = helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=IR_VERSION)
        made.producer_name = "guidedog"
        onnx.checker.check_model(made, full_check=True)
        return made


def whole(weights: Weights) -> onnx.ModelProto:
    """`mel` float32[clips, 1, frames, 32] to `embeddings` float32[clips, 96, steps, 1]."""
    graph, x = Graph(), "mel"
    for layer, place in zip(LAYERS, places()):
        is_conv = isinstance(layer, Conv)
        x = graph.convolved(x, layer, place, weights) if is_conv else graph.pooled(x, layer)
    graph.nodes[-1].output[0] = "embeddings"
    into = ("mel", ["clips", 1, "frames", BANDS])
    return graph.model("embeddings", [into], [("embeddings", ["clips", EMBEDDING, "steps", 1])])


def stepwise(weights: Weights) -> onnx.ModelProto:
    """`frames` float32[1, 8, 32] and `memory` float32[1, m] to `embedding` float32[1, 96] and `memory_after`."""
    graph, at, kept = Graph(), 0, []
    x = graph.reshaped("frames", (1, 1, STEP_FRAMES, BANDS))
    channels, bands, rows = 1, BANDS, STEP_FRAMES
    for layer, place in zip(LAYERS, places()):
        if isinstance(layer, Pool):
            x = graph.pooled(x, layer)
            bands, rows = bands // layer.bands, rows // layer.time
            continue
        back = layer.time - 1
        if back:
            size = back * channels * bands
            before = graph.reshaped(graph.sliced("memory", at, at + size, 1), (1, channels, back, bands))
            x = graph.node("Concat", [before, x], axis=2)
            kept.append(graph.reshaped(graph.sliced(x, rows, rows + back, 2), (1, size)))
            at += size
        x = graph.convolved(x, layer, place, weights)
        channels = layer.channels
    graph.reshaped(x, (1, EMBEDDING))
    graph.nodes[-1].output[0] = "embedding"
    graph.nodes.append(helper.make_node("Concat", kept, ["memory_after"], axis=1))
    inputs = [("frames", [1, STEP_FRAMES, BANDS]), ("memory", [1, at])]
    return graph.model("embedding", inputs, [("embedding", [1, EMBEDDING]), ("memory_after", [1, at])])
