import numpy as np
import pytest

import export
import network
from golden import lcg
from words import LABELS


@pytest.fixture
def weights() -> network.Weights:
    rng = np.random.default_rng(0)
    return network.initial(rng, np.full(96, 0.1), np.full(96, 1.2))


def test_gradients_are_those_of_finite_differences(weights: network.Weights) -> None:
    exact = {name: value.astype(np.float64) for name, value in weights.items()}
    flat = np.maximum(lcg(6 * network.FLAT).reshape(6, -1), 0)
    target, scale = np.eye(len(LABELS))[[0, 1, 2, 3, 4, 5]], np.array([1, 2, 0.5, 1, 1, 1.0])
    found, _, loss = network.dense_gradients(exact, flat, target, scale)
    rng = np.random.default_rng(1)
    for name in network.DENSE:
        for _ in range(4):
            at = tuple(rng.integers(0, size) for size in exact[name].shape)
            ends = []
            for delta in (1e-6, -1e-6):
                moved = {**exact, name: exact[name].copy()}
                moved[name][at] += delta
                ends.append(network.dense_gradients(moved, flat, target, scale)[2])
            assert found[name][at] == pytest.approx((ends[0] - ends[1]) / 2e-6, rel=1e-4, abs=1e-7), (name, at)


def test_the_exported_head_is_this_one(weights: network.Weights, tmp_path) -> None:
    import onnxruntime

    path = tmp_path / "head.onnx"
    path.write_bytes(export.model(weights).SerializeToString())
    x = (3 * lcg(8 * 96)).reshape(1, 8, 96).astype(np.float32)
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    assert np.abs(session.run(None, {"embeddings": x})[0] - network.probabilities(weights, x)).max() < 1e-5
    for name, value in export.read(path).items():
        assert np.array_equal(value, weights[name])
