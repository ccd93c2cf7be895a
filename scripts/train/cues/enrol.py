"""Enrolment: the user says each cue five times, and the head's dense layers are fitted to that voice.

What the robot does in its own language, line by line; here it is tried. The convolutions stay, and only dense1 and
dense2 are trained, on two things:

* The user's clips, each put into VARIANTS scenes: resampled, levelled, over a background, so that the windows which end
  within half a second after the word are many. Of them what the convolutions make is kept, flat: float32[256] a window.
* Rehearsal: windows of the training data, kept as such flat features in config/cues/rehearsal.bin. Without them the
  head forgets all other voices and takes the user's other words for cues. What the head made of them before is what it
  has to make of them afterwards: so it stays as unsure of them as it was, which their labels would talk it out of.

Rehearsal's file, little-endian: the bytes "GDRH", u32 version 1, u32 windows n, u32 features 256, f32 scale; then
u8 label[n], u8 feature[n][256]: feature times scale is the value.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

import augment
import features
import learning
import network
from features import STEP
from network import Adam, Weights
from words import LABELS

MAGIC, VERSION = b"GDRH", 1


class Rehearsal(NamedTuple):
    flat: np.ndarray  # float32[n, 256]
    labels: np.ndarray  # int64[n]


def write_rehearsal(path: Path, rehearsal: Rehearsal) -> None:
    scale = float(np.quantile(rehearsal.flat.max(axis=1), 0.999)) / 255
    stored = np.clip(np.round(rehearsal.flat / scale), 0, 255).astype(np.uint8)
    n, width = stored.shape
    header = MAGIC + struct.pack("<IIIf", VERSION, n, width, scale)
    path.write_bytes(header + rehearsal.labels.astype(np.uint8).tobytes() + stored.tobytes())


def read_rehearsal(path: Path) -> Rehearsal:
    data = path.read_bytes()
    version, n, width, scale = struct.unpack_from("<IIIf", data, 4)
    if data[:4] != MAGIC or version != VERSION or len(data) != 20 + n * (1 + width):
        raise ValueError(f"{path} is no rehearsal set of version {VERSION}")
    labels = np.frombuffer(data, np.uint8, n, 20).astype(np.int64)
    return Rehearsal(np.frombuffer(data, np.uint8, n * width, 20 + n).reshape(n, width) * np.float32(scale), labels)


@dataclass(frozen=True)
class Recipe:
    variants: int = 24  # scenes of each clip
    shifts: int = 6  # windows of each scene, 80 ms apart
    speed: float = 0.12  # resampled by up to exp(+-speed)
    snr_db: tuple[float, float] = (5.0, 35.0)
    peak_db: tuple[float, float] = (-30.0, 0.0)
    steps: int = 400
    batch_user: int = 64
    batch_rehearsal: int = 192
    rate: float = 1e-3
    smoothing: float = 0.05  # of the user's labels: enough of a sure *forward* is left for the rule after a stop
    user_weight: float = 1.0


def drawn(weights: Weights, data: learning.Pool, count: int, rng: np.random.Generator) -> Rehearsal:
    """Windows to rehearse: two fifths cues, each as often; of all else what the head finds hard comes more often."""
    chances = learning.mine(weights, data, 4.0, rng)
    at = rng.choice(len(chances), count, p=chances)
    windows = data.windows(at, rng.integers(0, augment.SHIFTS, count))
    return Rehearsal(network.flattened(weights, windows), data.labels[at].astype(np.int64))


def scenes(clip: np.ndarray, recipe: Recipe, rng: np.random.Generator) -> list[np.ndarray]:
    """float32[SPAN] each: the clip as recorded, then resampled, coloured, over white or dark noise, at other levels.

    The noise is a white one through a one-pole low-pass of random corner: nothing that needs a Fourier transform.
    """
    made = []
    for k in range(recipe.variants):
        audio = clip if k == 0 else augment.faster(clip, float(np.exp(rng.uniform(-recipe.speed, recipe.speed))))
        end = augment.extent(audio)[1]
        at = augment.SPAN - (recipe.shifts - 1) * STEP - int(rng.integers(0, STEP))
        placed = np.zeros(augment.SPAN, np.float32)
        audio = audio[max(0, end - at) :]
        start = max(0, at - end)
        audio = audio[: augment.SPAN - start]
        placed[start : start + len(audio)] = audio
        if k:
            placed = tilted(placed, rng.uniform(-0.4, 0.4))
        noise = tilted(rng.standard_normal(augment.SPAN).astype(np.float32), rng.uniform(-0.9, 0.0))
        snr_db = recipe.snr_db[1] if k == 0 else rng.uniform(*recipe.snr_db)
        noise *= np.sqrt(augment.power(placed) / 10 ** (snr_db / 10) / np.mean(noise**2))
        mixed = placed + noise
        peak = 10 ** (rng.uniform(*recipe.peak_db) / 20)
        made.append((mixed * peak / max(float(np.abs(mixed).max()), 1e-6)).astype(np.float32))
    return made


def tilted(audio: np.ndarray, a: float) -> np.ndarray:
    """y[n] = x[n] + a x[n - 1] for a > -1 and < 1: darker above zero, brighter below."""
    return (audio + a * np.concatenate([np.zeros(1, np.float32), audio[:-1]])).astype(np.float32)


def user_windows(
    embedding: features.Embedding,
    weights: Weights,
    clips: list[tuple[int, np.ndarray]],
    recipe: Recipe,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:
    """Flat float32[n, 256] and labels of the user's clips."""
    flat, labels = [], []
    for label, clip in clips:
        for scene in scenes(clip, recipe, rng):
            mel = features.log_mel(scene)[: features.FRAMES + (augment.STEPS - 1) * features.STEP_FRAMES]
            embeddings = embedding.of_mel(mel)
            windows = np.lib.stride_tricks.sliding_window_view(embeddings, features.WINDOWS, axis=0).transpose(0, 2, 1)
            flat.append(network.flattened(weights, windows[-recipe.shifts :]))
            labels += [label] * recipe.shifts
    return np.concatenate(flat), np.array(labels)


def enrol(
    weights: Weights,
    user: tuple[np.ndarray, np.ndarray],
    rehearsal: Rehearsal,
    recipe: Recipe,
    rng: np.random.Generator,
) -> Weights:
    """New dense layers: Adam from the old ones, each batch part the user's windows and part rehearsal."""
    enrolled = {name: value.copy() for name, value in weights.items()}
    adam = Adam(enrolled, network.DENSE)
    flat, labels = user
    wanted = np.full((len(LABELS), len(LABELS)), recipe.smoothing / len(LABELS), np.float32)
    wanted += (1 - recipe.smoothing) * np.eye(len(LABELS), dtype=np.float32)
    before = network.classified(weights, rehearsal.flat)[1]
    scale = np.concatenate([np.full(recipe.batch_user, recipe.user_weight), np.ones(recipe.batch_rehearsal)]).astype(
        np.float32
    )
    for step in range(recipe.steps):
        own = rng.integers(0, len(labels), recipe.batch_user)
        old = rng.integers(0, len(rehearsal.labels), recipe.batch_rehearsal)
        seen = np.concatenate([flat[own], rehearsal.flat[old]])
        target = np.concatenate([wanted[labels[own]], before[old]])
        found, _, _ = network.dense_gradients(enrolled, seen, target, scale)
        adam.update(found, recipe.rate * (1 - step / recipe.steps))
    return enrolled
