"""The head: eight successive embeddings in, a probability for each label out. Plain numpy, gradients included.

x float32[n, 8, 96] -> (x - mean) / deviation, clamped to +-6
  -> conv1 (96 to 64, 3 wide) -> relu [n, 6, 64] -> conv2 (64 to 64, 3 wide) -> relu [n, 4, 64]
  -> flattened, channel by channel: index 4 c + t [n, 256] -> dense1 (64) -> relu -> dense2 (6) -> softmax
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from features import EMBEDDING, WINDOWS
from words import LABELS

CHANNELS, KERNEL, HIDDEN = 64, 3, 64
CLAMP = 6.0
STEPS_1, STEPS_2 = WINDOWS - KERNEL + 1, WINDOWS - 2 * (KERNEL - 1)
FLAT = CHANNELS * STEPS_2

Weights = dict[str, np.ndarray]

SHAPES: dict[str, tuple[int, ...]] = {
    "conv1.weight": (CHANNELS, EMBEDDING, KERNEL),
    "conv1.bias": (CHANNELS,),
    "conv2.weight": (CHANNELS, CHANNELS, KERNEL),
    "conv2.bias": (CHANNELS,),
    "dense1.weight": (HIDDEN, FLAT),
    "dense1.bias": (HIDDEN,),
    "dense2.weight": (len(LABELS), HIDDEN),
    "dense2.bias": (len(LABELS),),
}
DENSE = tuple(name for name in SHAPES if name.startswith("dense"))


def initial(rng: np.random.Generator, mean: np.ndarray, deviation: np.ndarray) -> Weights:
    """He's initialisation; mean and deviation float32[96] of the training embeddings."""
    weights: Weights = {"mean": mean.astype(np.float32), "deviation": deviation.astype(np.float32)}
    for name, shape in SHAPES.items():
        fan_in = int(np.prod(shape[1:]))
        scale = np.sqrt(2 / fan_in) if name.endswith("weight") else 0
        weights[name] = (scale * rng.standard_normal(shape)).astype(np.float32)
    return weights


def normalised(weights: Weights, x: np.ndarray) -> np.ndarray:
    return np.clip((x - weights["mean"]) / weights["deviation"], -CLAMP, CLAMP).astype(np.float32)


def unrolled(x: np.ndarray) -> np.ndarray:
    """float32[n, t - 2, 3 c] of float32[n, t, c]: what each place of a convolution sees."""
    n, t, c = x.shape
    return np.concatenate([x[:, k : t - KERNEL + 1 + k] for k in range(KERNEL)], axis=2)


def matrix(weight: np.ndarray) -> np.ndarray:
    """float32[3 c, out] of a convolution's float32[out, c, 3]."""
    return weight.transpose(2, 1, 0).reshape(-1, weight.shape[0])


def convolved(weights: Weights, z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """What the convolutions see and make of normalised z: the last is flat, float32[n, 256], after its relu."""
    seen1 = unrolled(z)
    made1 = np.maximum(seen1 @ matrix(weights["conv1.weight"]) + weights["conv1.bias"], 0)
    seen2 = unrolled(made1)
    made2 = np.maximum(seen2 @ matrix(weights["conv2.weight"]) + weights["conv2.bias"], 0)
    return seen1, made1, seen2, made2.transpose(0, 2, 1).reshape(len(z), FLAT)


def flattened(weights: Weights, x: np.ndarray) -> np.ndarray:
    """float32[n, 256] of embeddings float32[n, 8, 96]: all but the dense layers."""
    return convolved(weights, normalised(weights, x))[3]


def softmax(logits: np.ndarray) -> np.ndarray:
    powers = np.exp(logits - logits.max(axis=1, keepdims=True))
    return powers / powers.sum(axis=1, keepdims=True)


def classified(weights: Weights, flat: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Hidden float32[n, 64] and probabilities float32[n, 6] of float32[n, 256]."""
    hidden = np.maximum(flat @ weights["dense1.weight"].T + weights["dense1.bias"], 0)
    return hidden, softmax(hidden @ weights["dense2.weight"].T + weights["dense2.bias"])


def probabilities(weights: Weights, x: np.ndarray) -> np.ndarray:
    """float32[n, 6] of embeddings float32[n, 8, 96], a few thousand at a time."""
    if not len(x):
        return np.zeros((0, len(LABELS)), np.float32)
    parts = (x[i : i + 4096] for i in range(0, len(x), 4096))
    return np.concatenate([classified(weights, flattened(weights, part))[1] for part in parts])


def dense_gradients(
    weights: Weights, flat: np.ndarray, target: np.ndarray, scale: np.ndarray
) -> tuple[Weights, np.ndarray, float]:
    """Gradients of the dense layers and of `flat`, and the loss: the mean cross-entropy, windows weighed by scale[n].

    target float32[n, 6] may be smoothed.
    """
    hidden, p = classified(weights, flat)
    loss = float(-(scale * (target * np.log(np.maximum(p, 1e-9))).sum(axis=1)).mean())
    logits = (p - target) * (scale / len(flat))[:, None]
    below = (logits @ weights["dense2.weight"]) * (hidden > 0)
    gradients = {
        "dense2.weight": logits.T @ hidden,
        "dense2.bias": logits.sum(axis=0),
        "dense1.weight": below.T @ flat,
        "dense1.bias": below.sum(axis=0),
    }
    return gradients, below @ weights["dense1.weight"], loss


@dataclass
class Adam:
    """Kingma and Ba 2015, with Loshchilov and Hutter's decoupled weight decay (on matrices, not on biases)."""

    weights: Weights
    names: tuple[str, ...]
    decay: float = 0.0
    beta1: float = 0.9
    beta2: float = 0.999
    epsilon: float = 1e-8

    def __post_init__(self) -> None:
        self.step = 0
        self.first = {name: np.zeros_like(self.weights[name]) for name in self.names}
        self.second = {name: np.zeros_like(self.weights[name]) for name in self.names}

    def update(self, found: Weights, rate: float) -> None:
        self.step += 1
        for name in self.names:
            first, second = self.first[name], self.second[name]
            first += (1 - self.beta1) * (found[name] - first)
            second += (1 - self.beta2) * (found[name] ** 2 - second)
            unbiased = first / (1 - self.beta1**self.step)
            spread = np.sqrt(second / (1 - self.beta2**self.step)) + self.epsilon
            if name.endswith("weight"):
                self.weights[name] -= rate * self.decay * self.weights[name]
            self.weights[name] -= (rate * unbiased / spread).astype(np.float32)
