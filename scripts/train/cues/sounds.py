"""Recordings, and noises made by formula."""

from __future__ import annotations

import os
from pathlib import Path
from typing import NamedTuple

import numpy as np
import soundfile
from scipy.signal import lfilter

from synthesise import RATE, at_16_khz
from words import SYNTHETIC_CUES

ROOT = Path(__file__).parents[3]
DATA = Path(os.environ.get("GUIDEDOG_SPEECH", ROOT / "../shared/data/speech"))
PROMPTS = Path("/usr/share/asterisk/sounds")
PROMPTS_MAX = 300  # of each language
# Files of reading and noise are dealt so; the background of other training sounds has none of the first.
FOLDS, TEST_FOLD = 4, 0


class Recording(NamedTuple):
    name: str  # SET/WORD/FILE
    word: str  # empty where it is no single word
    fold: int
    audio: np.ndarray  # float32[n], 16 kHz


def read(path: Path) -> np.ndarray:
    audio, rate = soundfile.read(path, dtype="float32", always_2d=True)
    return at_16_khz(audio.mean(axis=1), rate).astype(np.float32)


def one_speaker() -> list[Recording]:
    """A private person's voice, which trains nothing."""
    paths = sorted((DATA / "one_speaker").glob("*/*.wav"))
    return [Recording(f"one_speaker/{p.parent.name}/{p.name}", p.parent.name, 0, read(p)) for p in paths]


def librispeech() -> list[Recording]:
    """One file a speaker."""
    paths = sorted((DATA / "librispeech").glob("*.flac"))
    return [Recording(f"librispeech/{p.name}", "", i % FOLDS, read(p)) for i, p in enumerate(paths)]


def noise() -> list[Recording]:
    paths = sorted((DATA / "noise").glob("*.wav"))
    return [Recording(f"noise/{p.name}", "", i % FOLDS, read(p)) for i, p in enumerate(paths)]


def prompts() -> list[Recording]:
    """Telephone prompts in five languages, a speaker each (Debian's asterisk-core-sounds-*-wav), for training alone."""
    made = []
    for folder in sorted(PROMPTS.glob("*_*")):
        paths = [p for p in sorted(folder.rglob("*.wav")) if not any(cue in p.name for cue in SYNTHETIC_CUES)]
        for p in paths[:: -(-len(paths) // PROMPTS_MAX)]:
            made.append(Recording(f"prompts/{folder.name}/{p.name}", "", -1, read(p)))
    return [r for r in made if len(r.audio) > RATE // 2]


# --- Noises by formula: float32[n] of unit power


def unit(audio: np.ndarray) -> np.ndarray:
    return (audio / max(float(np.sqrt(np.mean(audio**2))), 1e-9)).astype(np.float32)


def coloured(rng: np.random.Generator, n: int, slope_db_per_octave: float) -> np.ndarray:
    """Noise whose spectrum falls by a slope: 0 white, -3 pink, -6 brown."""
    spectrum = np.fft.rfft(rng.standard_normal(n))
    octaves = np.log2(np.maximum(np.arange(len(spectrum)), 1) * RATE / n / 1000 + 0.03)
    return unit(np.fft.irfft(spectrum * 10 ** (slope_db_per_octave * octaves / 20), n))


def thud(rng: np.random.Generator, hz: float, decay_s: float, click: float) -> np.ndarray:
    """A foot that lands: a low resonance that dies away, and a broadband click of the sole."""
    t = np.arange(int(decay_s * 6 * RATE)) / RATE
    body = np.sin(2 * np.pi * hz * t + rng.uniform(0, 6)) * np.exp(-t / decay_s)
    sole = lfilter([1, -0.7], [1], rng.standard_normal(len(t))) * np.exp(-t / (decay_s * 0.25))
    return body + click * sole


def footsteps(rng: np.random.Generator, n: int) -> np.ndarray:
    """Four legs, each 1.5 to 3 times a second, in a trot's pairs or a walk's order, no two landings alike."""
    audio = np.zeros(n + RATE)
    period = 1 / rng.uniform(1.5, 3.0)
    phases = rng.choice([[0, 0.5, 0.5, 0], [0, 0.25, 0.5, 0.75]])
    hz, decay, click = rng.uniform(60, 250), rng.uniform(0.01, 0.04), rng.uniform(0.1, 1.0)
    for phase in phases:
        gain = rng.uniform(0.6, 1.0)
        at = (phase + rng.uniform(0, 1)) * period
        while at < n / RATE:
            sound = gain * rng.uniform(0.6, 1.0) * thud(rng, hz * rng.uniform(0.9, 1.1), decay, click)
            start = int(at * RATE)
            audio[start : start + len(sound)] += sound[: len(audio) - start]
            at += period * rng.uniform(0.96, 1.04)
    return unit(audio[:n])


def motors(rng: np.random.Generator, n: int) -> np.ndarray:
    """Hum with its harmonics, whines that follow the gait, and a fan's hiss."""
    t = np.arange(n) / RATE
    gait = 1 + rng.uniform(0, 0.08) * np.sin(2 * np.pi * rng.uniform(1, 4) * t + rng.uniform(0, 6))
    audio = np.zeros(n)
    for low, high, harmonics in ((40, 200, 12), (600, 3500, 3)):
        for _ in range(2):
            phase = 2 * np.pi * np.cumsum(rng.uniform(low, high) * gait) / RATE
            loudness = rng.uniform(0.1, 1.0) * (0.4 if low > 500 else 1.0)
            for k in range(1, harmonics + 1):
                audio += loudness * rng.uniform(0.2, 1) / k * np.sin(k * phase + rng.uniform(0, 6))
    return unit(audio + rng.uniform(0.05, 1.0) * coloured(rng, n, rng.uniform(-6, 0)))


def robot(rng: np.random.Generator, n: int) -> np.ndarray:
    """A walking quadruped: footsteps over motors."""
    return unit(footsteps(rng, n) + rng.uniform(0.1, 1.0) * motors(rng, n))


def chirps(rng: np.random.Generator, n: int) -> np.ndarray:
    """Beeps, barks, mews and squeaks: short sounds with harmonics whose pitch glides."""
    audio = 0.01 * rng.standard_normal(n)
    at = rng.uniform(0, 0.3)
    while at < n / RATE - 0.1:
        length = int(rng.uniform(0.05, 0.6) * RATE)
        t = np.linspace(0, 1, length)
        hz = rng.uniform(120, 2500) * (1 + rng.uniform(-0.5, 0.8) * t + rng.uniform(-0.3, 0.3) * np.sin(np.pi * t))
        phase = 2 * np.pi * np.cumsum(hz) / RATE
        fall = rng.uniform(0.2, 2)
        sound = sum(
            np.sin(k * phase + rng.uniform(0, 6)) / k**fall for k in range(1, int(min(12, 7000 / hz.max())) + 1)
        )
        sound = sound * np.sin(np.pi * t) ** rng.uniform(0.2, 2) + rng.uniform(0, 0.3) * rng.standard_normal(length)
        start = int(at * RATE)
        audio[start : start + length] += sound[: n - start]
        at += length / RATE + rng.exponential(0.3)
    return unit(audio)


def bursts(rng: np.random.Generator, n: int) -> np.ndarray:
    """Knocks, crockery, rustle, water: noise in bands that comes and goes."""
    audio = np.zeros(n)
    for _ in range(rng.integers(1, 5)):
        a = rng.uniform(0.8, 0.995)
        hz = rng.uniform(150, 5000)
        band = lfilter([1 - a], [1, -2 * a * np.cos(2 * np.pi * hz / RATE), a * a], rng.standard_normal(n))
        points = max(2, int(n / RATE * rng.uniform(2, 25)))
        gate = np.interp(np.linspace(0, points - 1, n), np.arange(points), rng.random(points) ** rng.uniform(1, 8))
        audio += unit(band) * gate
    return unit(audio)


def music(rng: np.random.Generator, n: int) -> np.ndarray:
    """Chords with harmonics, a bass and a drum, to a beat."""
    beat = int(RATE * 60 / rng.uniform(70, 150))
    t = np.arange(4 * beat) / RATE
    root, fall, decay_s = rng.uniform(110, 330), rng.uniform(0.8, 2.5), rng.uniform(0.2, 3)
    drum, audio = rng.uniform(0, 1.5), np.zeros(n + 5 * beat)
    for start in range(0, n, 4 * beat):
        steps = int(rng.choice([0, 5, 7, 9, -3])) + np.array([-12, 0, rng.choice([3, 4]), 7, 12])
        for hz in root * 2 ** (steps / 12):
            tone = sum(np.sin(2 * np.pi * k * hz * t + rng.uniform(0, 6)) / k**fall for k in range(1, 9))
            audio[start : start + len(t)] += tone * np.exp(-(t % (rng.choice([1, 2, 4]) * beat / RATE)) / decay_s)
        for k in range(4):
            hit = thud(rng, 80 if k % 2 == 0 else 180, 0.03, 0.3 if k % 2 == 0 else 2.0)
            audio[start + k * beat : start + k * beat + len(hit)] += drum * hit
    return unit(audio[:n])


FORMULAS = (coloured, robot, motors, footsteps, chirps, bursts)


def by_formula(rng: np.random.Generator, n: int) -> np.ndarray:
    kind = FORMULAS[rng.choice(len(FORMULAS), p=[0.25, 0.3, 0.1, 0.1, 0.12, 0.13])]
    return coloured(rng, n, rng.uniform(-7, 2)) if kind is coloured else kind(rng, n)
