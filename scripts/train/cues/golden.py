"""shared/hearing/tests/golden.json: what the robot's own code must compute from a signal that it makes itself."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np

import augment
import evaluate
import export
import features
import network
from rules import FRAMES, Rules, detect
from words import LABELS

ROOT = Path(__file__).parents[3]
PATH = ROOT / "shared/hearing/tests/golden.json"
STEPS_A_SPAN = 4

SIGNAL = (
    "x[n] for n = 0..47999, t = n / 16000, in float64 and then rounded to float32: "
    "x = 0.3 sin(2 pi (200 t + 150 t^2)) + (0.1 sin(2 pi (1200 t + 300 t^2)) if floor(n / 4000) is odd) + 0.02 r[n], "
    "but x = 0 for 16000 <= n < 20000. r[n] = s[n] / 2^31 - 1 "
    "with s[n] = (1664525 s[n-1] + 1013904223) mod 2^32, s[-1] = 1; "
    "s goes on through the zeros."
)


def lcg(count: int, state: int = 1) -> np.ndarray:
    """float64[count] in [-1, 1): Numerical Recipes' generator."""
    made = np.empty(count)
    for i in range(count):
        state = (1664525 * state + 1013904223) % 2**32
        made[i] = state / 2**31 - 1
    return made


def signal() -> np.ndarray:
    n = np.arange(48_000)
    t = n / features.RATE
    x = 0.3 * np.sin(2 * np.pi * (200 * t + 150 * t**2))
    x += np.where(n // 4000 % 2 == 1, 0.1 * np.sin(2 * np.pi * (1200 * t + 300 * t**2)), 0)
    x += 0.02 * lcg(len(n))
    x[16_000:20_000] = 0
    return x.astype(np.float32)


def rounded(values: np.ndarray, digits: int = 6) -> Any:
    return np.round(np.asarray(values, np.float64), digits).tolist()


def case(
    name: str, rules: Rules, spans: list[tuple[int, str, float, float]], periodicity: float = 0.9
) -> dict[str, Any]:
    """Spans of 80 ms: (how many, label, its probability, level in dB); the rest of the probability is `other`'s.

    What is loud is as periodic as told, what is not is not periodic at all.
    """
    probabilities, levels, periodicities = [], [], []
    spans = [(STEPS_A_SPAN * count, *rest) for count, *rest in spans]
    for steps, label, p, level in spans:
        row = np.zeros(len(LABELS), np.float32)
        row[LABELS.index("other")] = 1 - p
        row[LABELS.index(label)] += p
        probabilities += [row] * steps
        levels += [[level] * FRAMES] * steps
        periodicities += [[periodicity if level > -40 else 0.0] * FRAMES] * steps
    found = detect(rules, np.array(probabilities), np.array(levels), np.array(periodicities))
    return {
        "name": name,
        "rules": dataclasses.asdict(rules),
        "spans": [dict(zip(("steps", "label", "probability", "level_db"), span)) for span in spans],
        "periodicity": periodicity,
        "detections": [f._replace(score=round(f.score, 4))._asdict() for f in found],
    }


def cases() -> list[dict[str, Any]]:
    rules = Rules()
    quiet, loud = -60.0, -20.0
    silence = (20, "other", 1.0, quiet)
    talk = [silence, (16, "other", 1.0, loud), (4, "other", 1.0, quiet)]
    in_talk = [*talk, (8, "other", 1.0, quiet)]
    said_loudly = [(4, "other", 1.0, quiet), (5, "other", 1.0, 0.0), (3, "left", 0.9, quiet), silence]
    return [
        case(
            "a lone direction, reported once it is quiet",
            rules,
            [silence, (6, "other", 1.0, loud), (3, "left", 0.9, quiet), (20, "other", 1.0, quiet)],
        ),
        case(
            "80 ms are none",
            rules,
            [silence, (6, "other", 1.0, loud), (1, "left", 0.99, quiet), (20, "other", 1.0, quiet)],
        ),
        case(
            "a direction in running speech is dropped",
            rules,
            [silence, (20, "other", 1.0, loud), (3, "right", 0.95, loud), (20, "other", 1.0, loud), silence],
        ),
        case(
            "a direction at the end of running speech is dropped",
            rules,
            [silence, (20, "other", 1.0, loud), (4, "right", 0.95, quiet), (20, "other", 1.0, quiet)],
        ),
        case(
            "a direction that is never followed by quiet is dropped",
            rules,
            [silence, (4, "other", 1.0, loud), (3, "right", 0.95, loud), (7, "other", 1.0, loud), silence],
        ),
        case(
            "stop in running speech, and not again within a second",
            rules,
            [
                silence,
                (10, "other", 1.0, loud),
                (4, "stop", 0.9, loud),
                (5, "other", 1.0, loud),
                (2, "stop", 0.95, loud),
                silence,
                (2, "stop", 0.95, loud),
                silence,
            ],
        ),
        case(
            "stop ends what waits",
            rules,
            [silence, (4, "left", 0.9, loud), (1, "stop", 0.8, loud), (20, "other", 1.0, quiet)],
        ),
        case(
            "forward after a stop needs more",
            rules,
            [
                silence,
                (2, "stop", 0.9, loud),
                silence,
                (5, "other", 1.0, loud),
                (3, "forward", 0.8, quiet),
                silence,
                (5, "other", 1.0, loud),
                (3, "forward", 0.9, quiet),
                silence,
                (5, "other", 1.0, loud),
                (3, "forward", 0.8, quiet),
                silence,
            ],
        ),
        case(
            "another direction within a second is not reported",
            rules,
            [
                silence,
                (5, "other", 1.0, loud),
                (8, "left", 0.9, quiet),
                (4, "right", 0.9, quiet),
                (12, "other", 1.0, quiet),
                (5, "other", 1.0, loud),
                (3, "right", 0.9, quiet),
                silence,
            ],
        ),
        case(
            "levels that never rise: nobody has spoken",
            rules,
            [silence, (3, "left", 0.9, quiet), silence],
        ),
        case(
            "a clatter is no voice, and no direction",
            rules,
            [silence, (6, "other", 1.0, loud), (3, "left", 0.9, quiet), (20, "other", 1.0, quiet)],
            periodicity=0.6,
        ),
        case(
            "a stop needs no voice",
            rules,
            [silence, (6, "other", 1.0, loud), (3, "stop", 0.9, quiet), (20, "other", 1.0, quiet)],
            periodicity=0.6,
        ),
        case(
            "in talk no direction is given, and a stop has to be surer for longer; after six seconds all is as before",
            rules,
            [
                *talk,
                (5, "other", 1.0, loud),
                (3, "left", 0.9, quiet),
                (8, "other", 1.0, quiet),
                (3, "stop", 0.95, loud),
                (80, "other", 1.0, quiet),
                (5, "other", 1.0, loud),
                (3, "left", 0.9, quiet),
                (20, "other", 1.0, quiet),
                (1, "stop", 0.88, loud),
                silence,
            ],
        ),
        case(
            "in talk a stop in doubt counts when it is said again",
            rules,
            [*in_talk, (3, "stop", 0.88, loud), (6, "other", 1.0, quiet), (1, "stop", 0.88, loud), silence],
        ),
        case(
            "in talk a stop in doubt does not count when it flickers, or is said again much later",
            rules,
            [
                *in_talk,
                (1, "stop", 0.88, loud),
                (1, "other", 1.0, quiet),
                (1, "stop", 0.88, loud),
                (32, "other", 1.0, quiet),
                (1, "stop", 0.88, loud),
                silence,
            ],
        ),
        case(
            "a stop in doubt ends what waits",
            rules,
            [
                silence,
                (13, "other", 1.0, loud),
                (3, "other", 1.0, quiet),
                (5, "other", 1.0, loud),
                (2, "left", 0.9, loud),
                (1, "stop", 0.88, loud),
                silence,
            ],
        ),
        case(
            "a voice that is softer than the word by the depth is talk",
            rules,
            [(20, "other", 1.0, quiet), (16, "other", 1.0, -20.0), *said_loudly],
        ),
        case(
            "a voice that is softer than that is no talk",
            rules,
            [(20, "other", 1.0, quiet), (16, "other", 1.0, -20.1), *said_loudly],
        ),
        case(
            "a noise before a stop is no talk",
            rules,
            [*talk, (1, "stop", 0.8, loud), silence],
            periodicity=0.6,
        ),
        case(
            "a direction that waits already as talk begins is given",
            rules,
            [
                silence,
                (13, "other", 1.0, loud),
                (3, "other", 1.0, quiet),
                (5, "other", 1.0, loud),
                (2, "left", 0.9, loud),
                silence,
            ],
        ),
        case(
            "a voice that is as loud as what is always there is no direction",
            dataclasses.replace(rules, isolated=False),
            [(20, "other", 1.0, loud), (3, "left", 0.9, loud + 4), (20, "other", 1.0, loud)],
        ),
    ]


def dense(weights: network.Weights) -> dict[str, Any]:
    """Gradients and three steps of Adam over twelve windows of features by formula."""
    flat = np.maximum(lcg(12 * network.FLAT, 7).reshape(12, -1), 0).astype(np.float32)
    labels = np.arange(12) % len(LABELS)
    target = (0.95 * np.eye(len(LABELS)) + 0.05 / len(LABELS))[labels].astype(np.float32)
    one = np.ones(12, np.float32)
    found, _, loss = network.dense_gradients(weights, flat, target, one)
    after = {name: value.copy() for name, value in weights.items()}
    adam = network.Adam(after, network.DENSE)
    for _ in range(3):
        adam.update(network.dense_gradients(after, flat, target, one)[0], 1e-3)
    return {
        "what": "flat[i][j] = max(0, r[256 i + j]) with r as in the signal but s[-1] = 7, 12 windows, "
        "window i of label i mod 6, "
        "targets smoothed by 0.05, all weights 1; then three steps of Adam (0.9, 0.999, 1e-8) at rate 0.001",
        "loss": loss,
        "gradient_norms": {name: float(np.linalg.norm(found[name])) for name in network.DENSE},
        "dense2_bias_gradient": rounded(found["dense2.bias"], 8),
        "probabilities_before": rounded(network.classified(weights, flat[:2])[1], 7),
        "probabilities_after": rounded(network.classified(after, flat[:2])[1], 7),
        "loss_after": network.dense_gradients(after, flat, target, one)[2],
    }


def golden(fold: Path, head: Path) -> dict[str, Any]:
    samples = signal()
    mel = features.log_mel(samples)
    shipped = evaluate.read(fold)
    embedding = features.Embedding(shipped.embedding)
    embeddings = embedding.of_mel(mel)
    probabilities = evaluate.probabilities(embedding, export.read(head), mel)
    some = (0, 50, 98, 101, 110, 124, 150, 296)
    return {
        "signal": SIGNAL,
        "samples": {str(n): float(samples[n]) for n in (0, 1, 2, 3999, 4000, 15_999, 16_000, 20_000, 47_999)},
        "log_mel": {str(k): rounded(mel[k]) for k in some},
        "periodicity": {str(k): round(float(features.periodicity(samples)[k]), 5) for k in some},
        "levels_db": {str(k): round(float(augment.levels_db(mel[k : k + 1])[0]), 5) for k in some},
        "embeddings": {str(m): rounded(embeddings[m], 5) for m in (0, len(embeddings) - 1)},
        "head": {"sha256": export.sha256(head), "probabilities": rounded(probabilities, 7)},
        "rules": cases(),
        "dense": dense(export.read(head)),
    }


def text(fold: Path, head: Path) -> str:
    return json.dumps(golden(fold, head), indent=1) + "\n"
