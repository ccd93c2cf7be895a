"""The network in torch is the one that the robot hears with, before it is changed."""

import numpy as np
import pytest

import features
from golden import lcg

torch = pytest.importorskip("torch")

import tune  # noqa: E402


def test_it_begins_as_the_embedding(embedding: features.Embedding) -> None:
    mel = (3 * lcg(tune.SEEN * features.BANDS)).reshape(tune.SEEN, features.BANDS).astype(np.float32)
    with torch.no_grad():
        found = tune.Trunk().eval()(torch.from_numpy(mel)[None, None])[0].numpy()
    assert np.abs(found - embedding.of_mel(mel)).max() < 1e-3


def test_a_saved_network_hears_as_before(tmp_path, embedding: features.Embedding) -> None:
    torch.manual_seed(0)
    ears = tune.Ears().eval()
    mel = lcg(200 * features.BANDS).reshape(200, features.BANDS).astype(np.float32)
    before = tune.heard(ears, mel)
    tune.save(tmp_path / "fold-0.npz", ears)
    after = tune.heard(tune.load(tmp_path / "fold-0.npz"), mel)
    assert before.shape == (9, 7) and np.abs(before - after).max() < 2e-3


def test_alarms_are_counted_once_while_they_last() -> None:
    sure = np.zeros((60, 7))
    sure[[5, 6, 7, 30, 50, 51], 6] = 0.9
    assert tune.alarms(sure, 6, 1, 0.5) == 3
    assert tune.alarms(sure, 6, 2, 0.5) == 2
    assert tune.surest(sure, 6, 2) == 0.9 and tune.surest(sure, 6, 4) == 0.0
