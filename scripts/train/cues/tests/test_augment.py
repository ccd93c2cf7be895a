import numpy as np

import augment
import features
from features import RATE


def word(hz: float = 300.0, seconds: float = 0.4) -> np.ndarray:
    t = np.arange(int(seconds * RATE)) / RATE
    return (0.5 * np.sin(2 * np.pi * hz * t) * np.sin(np.pi * t / seconds)).astype(np.float32)


def pitch_hz(audio: np.ndarray) -> float:
    return float(np.argmax(np.abs(np.fft.rfft(audio, 1 << 16))) * RATE / (1 << 16))


def test_faster_is_shorter_and_higher_and_stretched_only_longer() -> None:
    assert abs(len(augment.faster(word(), 1.25)) / len(word()) - 0.8) < 0.01
    assert abs(pitch_hz(augment.faster(word(), 1.25)) / 300 - 1.25) < 0.02
    longer = augment.stretched(word(), 1.3)
    assert abs(len(longer) / len(word()) - 1.3) < 0.1
    assert abs(pitch_hz(longer) / 300 - 1) < 0.03


def test_a_word_is_found_in_its_clip() -> None:
    clip = np.pad(word(), (4000, 6000)) + 1e-4 * np.random.default_rng(0).standard_normal(16_400)
    start, end = augment.extent(clip.astype(np.float32))
    assert abs(start - 4000) < 800 and abs(end - 10_400) < 800


def test_a_placed_word_is_whole_in_each_window() -> None:
    rng = np.random.default_rng(0)
    scene = augment.Scene([], [])
    for _ in range(20):
        placed = scene.placed(word(), len(word()), rng)
        first_window = placed[: features.HEAD_SPAN]
        assert len(placed) == augment.SPAN
        assert np.isclose(np.sum(first_window**2), np.sum(word() ** 2), rtol=1e-5)


def test_scenes_keep_the_word_and_the_range() -> None:
    rng = np.random.default_rng(0)
    scene = augment.Scene([], [])
    for _ in range(30):
        heard = scene.heard(scene.placed(scene.voice(word(), rng), len(word()), rng), rng)
        assert heard.shape == (augment.SPAN,) and heard.dtype == np.float32
        assert np.isfinite(heard).all() and np.abs(heard).max() <= 1
        mel = scene.mel(heard)
        assert mel.shape == (features.FRAMES + (augment.STEPS - 1) * features.STEP_FRAMES, features.BANDS)
