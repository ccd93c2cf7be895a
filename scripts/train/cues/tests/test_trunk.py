"""Step by step, over a whole stretch and in torch the embedding is the same."""

import numpy as np
import onnxruntime
import pytest

import evaluate
import features
import trunk
from golden import signal
from ship import CONFIG, FOLDS_PATH, SHIPPED


def test_a_step_at_a_time_gives_what_the_whole_stretch_gives(embedding: features.Embedding) -> None:
    mel = features.log_mel(signal())
    session = onnxruntime.InferenceSession(str(CONFIG / "embedding.onnx"), providers=["CPUExecutionProvider"])
    memory, made = np.zeros((1, trunk.memory_numbers()), np.float32), []
    # The first step's newer half is the stretch's beginning: 76 frames are nine steps and a half.
    padded = np.concatenate([np.zeros((4, features.BANDS), np.float32), mel])
    for start in range(0, len(padded) - 7, 8):
        frames = padded[None, start : start + 8]
        found, memory = session.run(["embedding", "memory_after"], {"frames": frames, "memory": memory})
        made.append(found[0])
    assert np.abs(np.array(made[9:]) - embedding.of_mel(mel)).max() < 1e-4


def test_it_is_the_network_in_torch(embedding: features.Embedding) -> None:
    torch = pytest.importorskip("torch")
    import tune

    mel = features.log_mel(signal())
    with torch.no_grad():
        found = tune.load(FOLDS_PATH / f"fold-{SHIPPED}.npz").trunk(torch.from_numpy(mel)[None, None])[0].numpy()
    assert np.abs(found - embedding.of_mel(mel)).max() < 1e-3


def test_lanes_take_turns(shipped: evaluate.Network, embedding: features.Embedding) -> None:
    mel = features.log_mel(signal())
    found = evaluate.probabilities(embedding, shipped.head, mel)
    assert found.shape == ((len(mel) - 132) // 2 + 1, 6)
    assert np.abs(found.sum(axis=1) - 1).max() < 1e-5
    for step in (0, 1, 2, 3, 4, len(found) - 1):
        alone = evaluate.probabilities(embedding, shipped.head, mel[2 * step : 2 * step + 132])
        assert np.abs(alone[0] - found[step]).max() < 1e-4
