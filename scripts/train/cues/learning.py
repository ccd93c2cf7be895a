"""Fits a head to the training windows."""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np

import network
from augment import SHIFTS
from features import WINDOWS
from network import Adam, Weights
from windows import GROUPS, OTHER, Group, group
from words import LABELS

# In what proportion the groups are drawn. Cues are about two fifths: as rare as in life, they would not be learnt.
# Where a group is kept back or missing, the others have its part.
SHARES: dict[str, float] = {
    "cues_kokoro": 0.12,
    "cues_kokoro_hard": 0.05,
    "cues_espeak": 0.03,
    "cues_espeak_hard": 0.01,
    "cues_accents": 0.05,
    "cues_accents_hard": 0.02,
    "cues_flite": 0.02,
    "cues_real": 0.08,
    "cues_real_hard": 0.03,
    "cues_speaker": 0.04,
    "alikes_kokoro": 0.05,
    "alikes_espeak": 0.02,
    "alikes_accents": 0.02,
    "alikes_flite": 0.01,
    "words_kokoro": 0.03,
    "words_kokoro_hard": 0.02,
    "words_espeak": 0.01,
    "words_flite": 0.01,
    "words_real": 0.09,
    "words_real_hard": 0.03,
    "words_speaker": 0.03,
    "partial": 0.02,
    "reading": 0.10,
    "reading_others": 0.08,
    "babble": 0.02,
    "prompts": 0.05,
    "noise": 0.04,
    "backgrounds": 0.05,
    "robots": 0.03,
}


@dataclass
class Pool:
    """All sequences that may train, and how often each is drawn."""

    sequences: np.ndarray  # float16[n, 13, 96]
    labels: np.ndarray  # int8[n]
    chances: np.ndarray  # float64[n], sum 1

    def windows(self, at: np.ndarray, shift: np.ndarray) -> np.ndarray:
        """float32[len(at), 8, 96]"""
        steps = shift[:, None] + np.arange(WINDOWS)
        return self.sequences[at[:, None], steps].astype(np.float32)


def pool(kept_back: set[int], shares: dict[str, float] = SHARES) -> Pool:
    """Without the recordings of the folds that are kept back. Within a group each label is drawn as often."""
    parts: list[Group] = []
    chances = []
    for name in GROUPS:
        made = group(name)
        if made is None or not shares.get(name):
            continue
        usable = ~np.isin(made.folds, sorted(kept_back))
        made = Group(made.sequences[usable], made.labels[usable], made.folds[usable])
        counts = np.bincount(made.labels, minlength=len(LABELS))
        chance = 1.0 / counts[made.labels] / np.count_nonzero(counts)
        parts.append(made)
        chances.append(shares[name] * chance)
    chance = np.concatenate(chances)
    return Pool(
        np.concatenate([p.sequences for p in parts]), np.concatenate([p.labels for p in parts]), chance / chance.sum()
    )


@dataclass(frozen=True)
class Recipe:
    steps: int = 8000
    batch: int = 256
    rate: float = 2e-3
    decay: float = 0.02
    dropout: float = 0.25
    jitter: float = 0.1  # noise on the normalised embeddings
    smoothing: float = 0.05
    mine_every: int = 1000
    mined_boost: float = 8.0
    average: float = 0.999


def mine(weights: Weights, data: Pool, boost: float, rng: np.random.Generator) -> np.ndarray:
    """Chances after a look at what the head gets wrong: hard sequences are drawn up to 1 + boost times as often."""
    wrong = np.zeros(len(data.labels), np.float32)
    for start in range(0, len(wrong), 8192):
        at = np.arange(start, min(start + 8192, len(wrong)))
        shift = rng.integers(0, SHIFTS, len(at))
        p = network.probabilities(weights, data.windows(at, shift))
        wrong[at] = 1 - p[np.arange(len(at)), data.labels[at]]
    chances = data.chances * (1 + boost * wrong)
    # What is lost among the words of one label must not shift the balance between cues and all else.
    for cue in (True, False):
        of_kind = (data.labels != OTHER) == cue
        chances[of_kind] *= data.chances[of_kind].sum() / chances[of_kind].sum()
    return chances / chances.sum()


def judged(weights: Weights, data: Pool) -> np.ndarray:
    """float32[n, 6, 5]: what a head makes of each window."""
    made = np.empty((len(data.labels), SHIFTS, len(LABELS)), np.float32)
    for shift in range(SHIFTS):
        for start in range(0, len(made), 8192):
            at = np.arange(start, min(start + 8192, len(made)))
            made[at, shift] = network.probabilities(weights, data.windows(at, np.full(len(at), shift)))
    return made


def fit(
    data: Pool, seed: int, recipe: Recipe = Recipe(), progress: str = "", taught: np.ndarray | None = None
) -> Weights:
    """Adam with a warm start and a cosine's fall; what is returned is the running mean of the weights.

    Taught float32[n, 6, 5] are targets for each window in place of the labels.
    """
    rng = np.random.default_rng(seed)
    sample = rng.choice(len(data.labels), 4096, p=data.chances)
    embeddings = data.sequences[sample].reshape(-1, data.sequences.shape[-1]).astype(np.float32)
    weights = network.initial(rng, embeddings.mean(axis=0), embeddings.std(axis=0) + 1e-3)
    adam = Adam(weights, tuple(network.SHAPES), recipe.decay)
    mean: Weights = {name: value.copy() for name, value in weights.items()}
    cumulative = np.cumsum(data.chances)
    targets = np.full((len(LABELS), len(LABELS)), recipe.smoothing / len(LABELS), np.float32)
    targets += (1 - recipe.smoothing) * np.eye(len(LABELS), dtype=np.float32)
    ones = np.ones(recipe.batch, np.float32)
    lately = 0.0
    for step in range(recipe.steps):
        if step and step % recipe.mine_every == 0:
            cumulative = np.cumsum(mine(mean, data, recipe.mined_boost, rng))
        at = np.minimum(np.searchsorted(cumulative, rng.random(recipe.batch)), len(cumulative) - 1)
        shift = rng.integers(0, SHIFTS, recipe.batch)
        target = targets[data.labels[at]] if taught is None else taught[at, shift]
        z = network.normalised(weights, data.windows(at, shift))
        z += recipe.jitter * rng.standard_normal(z.shape, dtype=np.float32)
        kept = (rng.random((recipe.batch, network.FLAT), dtype=np.float32) >= recipe.dropout) / np.float32(
            1 - recipe.dropout
        )
        found, loss = network.gradients(weights, z, target, ones, kept.astype(np.float32))
        warm = min(1.0, (step + 1) / 200)
        adam.update(found, recipe.rate * warm * (0.02 + 0.98 * 0.5 * (1 + np.cos(np.pi * step / recipe.steps))))
        follow = max(1 - recipe.average, 1 / (step + 1))
        for name in network.SHAPES:
            mean[name] += follow * (weights[name] - mean[name])
        lately += (loss - lately) * max(0.01, 1 / (step + 1))
        if progress and (step + 1) % 200 == 0:
            print(
                f"\r{progress}: step {step + 1} of {recipe.steps}, loss {lately:.3f} ",
                end="",
                file=sys.stderr,
                flush=True,
            )
    if progress:
        print(file=sys.stderr)
    return mean
