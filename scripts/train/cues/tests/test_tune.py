"""The network in torch, and how its training data is drawn."""

import numpy as np
import pytest

import features
from golden import lcg
from synthesise import BUILD

torch = pytest.importorskip("torch")

import tune  # noqa: E402


@pytest.mark.skipif(not tune.GOOGLES.exists(), reason=f"{BUILD}/google is missing: ./setup")
def test_it_begins_as_googles_embedding() -> None:
    import onnxruntime

    begun = tune.Trunk().eval()
    begun.begin_as(tune.GOOGLES)
    mel = (3 * lcg(features.FRAMES * features.BANDS)).reshape(1, features.FRAMES, features.BANDS, 1).astype(np.float32)
    session = onnxruntime.InferenceSession(str(tune.GOOGLES), providers=["CPUExecutionProvider"])
    theirs = session.run(None, {session.get_inputs()[0].name: mel})[0].ravel()
    with torch.no_grad():
        ours = begun(torch.from_numpy(mel).reshape(1, 1, features.FRAMES, features.BANDS)).numpy().ravel()
    assert np.abs(ours - theirs).max() < 1e-3


def test_a_saved_network_hears_as_before(tmp_path) -> None:
    torch.manual_seed(0)
    ears = tune.Ears().eval()
    mel = torch.from_numpy(lcg(tune.SEEN * features.BANDS).reshape(1, 1, tune.SEEN, features.BANDS).astype(np.float32))
    tune.save(tmp_path / "fold-0.npz", ears)
    with torch.no_grad():
        before, after = ears(mel), tune.load(tmp_path / "fold-0.npz")(mel)
    assert before.shape == (1, 6) and (before - after).abs().max() < 2e-2


def test_what_is_wrong_is_drawn_more_often_and_cues_as_often_as_before() -> None:
    labels = torch.tensor([0, 0, tune.OTHER, tune.OTHER])
    base = torch.tensor([0.3, 0.3, 0.2, 0.2], dtype=torch.float64)
    drawn = tune.boosted(torch.tensor([1.0, 0.0, 0.5, 0.0]), labels, base)
    assert float(drawn[0] / drawn[1]) == pytest.approx(9) and float(drawn[2] / drawn[3]) == pytest.approx(5)
    assert float(drawn[:2].sum()) == pytest.approx(0.6)
