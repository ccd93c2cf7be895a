"""From samples to speech embeddings, streaming: what the robot's own code computes, to the last constant.

Samples x are 16 kHz mono in [-1, 1].

* Frame k takes samples 160 k to 160 k + 511: 100 frames a second. The window w is a periodic Hann of 400 samples in
  the middle of the 512, w[56 + n] = 0.5 - 0.5 cos(2 pi n / 400) for n = 0..399, zero elsewhere.
* Power spectrum P[b] = |sum_n w[n] x[160 k + n] exp(-2 pi i b n / 512)|^2, b = 0..256, with no division by anything.
* 32 triangular bands on Slaney's mel scale, m(f) = 3 f / 200 below 1 kHz and 15 + 27 ln(f / 1000) / ln(6.4) from there
  on. Their 34 edges e lie evenly in mel between 60 and 3800 Hz. Band i rises from e[i] to e[i+1] and falls to e[i+2],
  linearly in Hz at f = 31.25 b, and has the area of one: height 2 / (e[i+2] - e[i]).
* Level in decibels D[i] = max(10 log10(max(sum_b M[b, i] P[b], 1e-10)), -85.7). The floor is fixed, where the network
  that this comes from takes 80 dB below the loudest of whatever was handed to it at once.
* Log-mel = D / 10 + 2.
* Embedding m of lane l is what the network makes of frames 2 l + 8 m to 2 l + 8 m + 75: one each 80 ms. There are four
  lanes, l = 0..3, 20 ms apart: what is decided then hardly depends on when a word falls into the 80 ms.
* The head sees embeddings m - 7 to m of one lane, oldest first: 1.342 s. That is step s = 4 (m - 7) + l: the first comes
  after 21,472 samples, and one each 20 ms.

Beside them, of each frame, how periodic the sound is, as a voice is and a clatter or rushing water is not: x goes from
rest through a band-pass of 80 to 900 Hz (Butterworth, two sections: BAND_PASS), every fourth sample of it, from the
fourth on, is y. Of frame k, s is the 218 of y until that of sample 160 k + 511, zeros where there were none yet, and
periodicity max over lags 8 to 58 (500 to 69 Hz) of sum_j s[j] s[j + lag] / sqrt(sum_j s[j]^2 sum_j s[j + lag]^2 +
1e-12), j = 0..159.
"""

from __future__ import annotations

import numpy as np
from scipy.signal import sosfilt

RATE = 16_000
FFT, WINDOW, HOP = 512, 400, 160
BANDS, BAND_LOW_HZ, BAND_HIGH_HZ = 32, 60.0, 3800.0
POWER_MIN, FLOOR_DB = 1e-10, -85.7
FRAMES, STEP_FRAMES, EMBEDDING = 76, 8, 96
LANES = 4
LANE_FRAMES = STEP_FRAMES // LANES
WINDOWS = 8
STEP = STEP_FRAMES * HOP
EMBEDDING_SPAN = (FRAMES - 1) * HOP + FFT
HEAD_SPAN = EMBEDDING_SPAN + (WINDOWS - 1) * STEP

DECIMATION, PERIODS, LAGS = 4, 160, range(8, 59)
# scipy.signal.butter(2, [80, 900], "bandpass", fs=RATE, output="sos"), to nine digits
BAND_PASS = [
    [0.021000375, 0.042000751, 0.021000375, 1.0, -1.573444971, 0.662020574],
    [1.0, -2.0, 1.0, 1.0, -1.956966607, 0.958092054],
]

def window() -> np.ndarray:
    """float64[512]: a periodic Hann of 400 samples in the middle."""
    padded = np.zeros(FFT)
    start = (FFT - WINDOW) // 2
    padded[start : start + WINDOW] = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(WINDOW) / WINDOW)
    return padded


def mel_of_hz(hz: np.ndarray) -> np.ndarray:
    return np.where(hz < 1000, hz * 3 / 200, 15 + 27 * np.log(np.maximum(hz, 1) / 1000) / np.log(6.4))


def hz_of_mel(mel: np.ndarray) -> np.ndarray:
    return np.where(mel < 15, mel * 200 / 3, 1000 * np.exp((mel - 15) * np.log(6.4) / 27))


def mel_weights() -> np.ndarray:
    """float64[257, 32]: what each of the FFT's bins gives to each band."""
    low, high = mel_of_hz(np.array([BAND_LOW_HZ, BAND_HIGH_HZ]))
    edges = hz_of_mel(np.linspace(low, high, BANDS + 2))
    below, peak, above = edges[:-2], edges[1:-1], edges[2:]
    hz = np.arange(FFT // 2 + 1)[:, None] * RATE / FFT
    triangle = np.minimum((hz - below) / (peak - below), (above - hz) / (above - peak))
    return np.maximum(triangle, 0) * 2 / (above - below)


WINDOW_WEIGHTS = window().astype(np.float32)
MEL_WEIGHTS = mel_weights().astype(np.float32)


def log_mel(samples: np.ndarray) -> np.ndarray:
    """float32[frames, 32] of float[n]; frames that would reach past the end are left out."""
    if len(samples) < FFT:
        return np.zeros((0, BANDS), np.float32)
    frames = np.lib.stride_tricks.sliding_window_view(np.asarray(samples, np.float32), FFT)[::HOP]
    spectrum = np.fft.rfft(frames * WINDOW_WEIGHTS, axis=1)
    power = (spectrum.real**2 + spectrum.imag**2).astype(np.float32)
    decibels = 10 * np.log10(np.maximum(power @ MEL_WEIGHTS, POWER_MIN))
    return (np.maximum(decibels, FLOOR_DB) / 10 + 2).astype(np.float32)


def periodicity(samples: np.ndarray) -> np.ndarray:
    """float32[frames] in [-1, 1] of float[n]: those of `log_mel`."""
    if len(samples) < FFT:
        return np.zeros(0, np.float32)
    low = sosfilt(BAND_PASS, samples)[DECIMATION - 1 :: DECIMATION]
    span = PERIODS + LAGS.stop - 1
    padded = np.concatenate([np.zeros(span), low[: (len(samples) - FFT) // HOP * HOP // DECIMATION + FFT // DECIMATION]])
    seen = np.lib.stride_tricks.sliding_window_view(padded, span)[FFT // DECIMATION :: HOP // DECIMATION]
    first = seen[:, :PERIODS]
    energy = (first**2).sum(axis=1)
    best = np.full(len(seen), -1.0)
    for lag in LAGS:
        later = seen[:, lag : lag + PERIODS]
        alike = (first * later).sum(axis=1) / np.sqrt(energy * (later**2).sum(axis=1) + 1e-12)
        best = np.maximum(best, alike)
    return best.astype(np.float32)


class Embedding:
    """A network of `trunk.whole`: over a longer stretch it gives, in one go, the embeddings that a step each gives."""

    def __init__(self, model: bytes, threads: int = 1) -> None:
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads
        options.log_severity_level = 3
        self.session = onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])

    def of_mel(self, mel: np.ndarray) -> np.ndarray:
        """float32[..., steps, 96] of log-mel float32[..., frames, 32]."""
        clips = mel.reshape(-1, 1, *mel.shape[-2:])
        steps = (mel.shape[-2] - FRAMES) // STEP_FRAMES + 1
        if steps < 1:
            return np.zeros((*mel.shape[:-2], 0, EMBEDDING), np.float32)
        made = self.session.run(None, {"mel": clips})[0]
        return made[..., 0].transpose(0, 2, 1).reshape(*mel.shape[:-2], steps, EMBEDDING)

    def of_stretch(self, mel: np.ndarray) -> np.ndarray:
        """float32[steps, 96] of log-mel float32[frames, 32], some at a time: what lies between its layers is large."""
        starts = range(0, max(1, len(mel) - FRAMES + 1), 4000)
        return np.concatenate([self.of_mel(mel[start : start + 4000 + FRAMES - STEP_FRAMES]) for start in starts])
