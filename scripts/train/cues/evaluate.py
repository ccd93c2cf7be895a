"""Plays recordings through head and rules, step by step as the robot hears them, and counts."""

from __future__ import annotations

import math
from collections import defaultdict
from typing import Callable, Iterable, NamedTuple

import numpy as np

import augment
import features
import network
import sounds
from features import FRAMES, HOP, RATE, STEP, STEP_FRAMES, WINDOWS
from network import Weights
from rules import Detection, Rules, detect
from sounds import TEST_FOLD, Recording
from synthesise import BUILD, held_out, load, seed_of
from words import CUES

# Near-silence before and after a clip. The first frame whose level counts is the clip's own: what is always there is
# then its noise, not ours, beside which all of it would be loud.
SILENCE = (FRAMES + (WINDOWS - 2) * STEP_FRAMES - 1) * HOP


class Stream(NamedTuple):
    name: str
    word: str  # empty where it is no single word
    fold: int
    end_s: float  # where the word ends; the length, where there is none
    hours: float  # without the silence around it
    embeddings: np.ndarray  # float16[steps, 96], from the first of the stream on
    levels: np.ndarray  # float32[steps - 7, 8]: of the steps that the head judges
    periodicities: np.ndarray  # likewise


def step_end_s(step: int) -> float:
    """When a step that the head judges is complete, in seconds of the stream."""
    return (features.HEAD_SPAN + step * STEP) / RATE


def stream(embedding: features.Embedding, recording: Recording, audio: np.ndarray, end_s: float) -> Stream:
    mel = features.log_mel(audio)
    embeddings = embedding.of_samples(audio)
    levels, periodicities = augment.levels_db(mel), features.periodicity(audio)
    newest = features.FRAMES - STEP_FRAMES + STEP_FRAMES * np.arange(len(embeddings))[:, None] + np.arange(STEP_FRAMES)
    return Stream(
        recording.name,
        recording.word,
        recording.fold,
        end_s,
        len(recording.audio) / RATE / 3600,
        embeddings.astype(np.float16),
        levels[newest][WINDOWS - 1 :],
        periodicities[newest][WINDOWS - 1 :],
    )


# --- Conditions: what is done to a clip (with the silence around it); rng is the clip's own

Condition = Callable[[np.ndarray, np.random.Generator], np.ndarray]


def noisy(snr_db: float, noises: list[np.ndarray] | None = None) -> Condition:
    """Real noise of the test fold, or a walking robot's by formula."""

    def condition(audio: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        if noises is None:
            noise = sounds.robot(rng, len(audio))
        else:
            noise = sounds.unit(augment.Scene([], []).piece(rng, noises, len(audio)))
        speech = audio[SILENCE:-SILENCE]
        mixed = audio + noise * np.sqrt(augment.power(speech) / 10 ** (snr_db / 10))
        return mixed / max(1.0, float(np.abs(mixed).max()))

    return condition


def shouted(audio: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Pitch and formants up 15 %, treble raised, clipped at three times full scale."""
    spectrum = np.fft.rfft(augment.faster(audio, 1.15))
    octaves = np.log2(np.maximum(np.arange(len(spectrum)) * RATE * 1.15 / len(audio), 100) / 1000)
    bright = np.fft.irfft(spectrum * 10 ** (np.clip(octaves, -2, 2) * 5 / 20))
    return np.clip(3 * bright / max(float(np.abs(bright).max()), 1e-9), -1, 1).astype(np.float32) * 0.9


def level(peak_db: float) -> Condition:
    return lambda audio, rng: audio * 10 ** (peak_db / 20) / max(float(np.abs(audio).max()), 1e-9)


def reverberant(rt60_s: float) -> Condition:
    return lambda audio, rng: augment.reverberated(audio, rng, rt60_s, 0.4)


def conditions() -> dict[str, Condition]:
    noises = [r.audio for r in sounds.noise() if r.fold == TEST_FOLD]
    return {
        "clean": lambda audio, rng: audio,
        "noise 20 dB": noisy(20, noises),
        "noise 10 dB": noisy(10, noises),
        "noise 5 dB": noisy(5, noises),
        "noise 0 dB": noisy(0, noises),
        "robot 10 dB": noisy(10),
        "shouted": shouted,
        "reverb 0.5 s": reverberant(0.5),
        "-35 dBFS": level(-35),
    }


# --- Sets


def held_out_voices() -> list[Recording]:
    """Synthetic voices that never train, every third clip of the many. Besides cues only Festival speaks."""
    made = []
    for family, every in (("kokoro", 1), ("espeak", 3), ("flite", 1), ("festival", 3)):
        wanted = [
            clip
            for clip in load(family)
            if len(clip.audio) and held_out(family, clip.voice) and (clip.text in CUES or family == "festival")
        ]
        for i, clip in enumerate(wanted[::every]):
            made.append(Recording(f"{family}/{clip.text}/{clip.voice}/{i}", clip.text, TEST_FOLD, clip.audio))
    return made


def forward() -> list[Recording]:
    """A real "go forward ten meters", if its Debian package is there."""
    return (
        [Recording("pocketsphinx/goforward", "", TEST_FOLD, sounds.read(sounds.FORWARD))]
        if sounds.FORWARD.exists()
        else []
    )


def noise_levels() -> list[Recording]:
    """Each noise at three levels; and five minutes by formula, of seeds that train nothing."""
    made = []
    for r in sounds.noise():
        for peak_db in (0, -15, -30):
            audio = r.audio * 10 ** (peak_db / 20) / max(float(np.abs(r.audio).max()), 1e-9)
            made.append(r._replace(name=f"{r.name} {peak_db} dB", audio=audio.astype(np.float32)))
    for i in range(15):
        rng = np.random.default_rng(seed_of("noise test", i))
        audio = sounds.robot(rng, 20 * RATE) if i % 3 else sounds.by_formula(rng, 20 * RATE)
        peak_db = rng.uniform(-30, 0)
        audio = audio * 10 ** (peak_db / 20) / float(np.abs(audio).max())
        made.append(Recording(f"noise/formula {i}", "", TEST_FOLD, audio.astype(np.float32)))
    return made


SETS: dict[str, Callable[[], list[Recording]]] = {
    "speech_commands": sounds.speech_commands,
    "one_speaker": sounds.one_speaker,
    "voices": held_out_voices,
    "forward": forward,
    "librispeech": sounds.librispeech,
    "noise": noise_levels,
}
CLIPS = ("speech_commands", "one_speaker", "voices")


def streams(name: str, condition: str = "clean") -> list[Stream]:
    """A set under a condition, made once and kept in build/streams."""
    path = BUILD / "streams" / f"{name} {condition}.npy"
    if path.exists():
        return [Stream(*row) for row in np.load(path, allow_pickle=True)]
    embedding = features.Embedding()
    apply = conditions()[condition]
    made = []
    for recording in SETS[name]():
        rng = np.random.default_rng(seed_of("evaluate", condition, recording.name))
        start, end = augment.extent(recording.audio) if recording.word else (0, len(recording.audio))
        audio = np.pad(recording.audio, SILENCE) + 10 ** (-70 / 20) * rng.standard_normal(
            len(recording.audio) + 2 * SILENCE
        )
        audio = apply(audio.astype(np.float32), rng)
        speed = 1.15 if condition == "shouted" else 1.0
        made.append(stream(embedding, recording, audio.astype(np.float32), (SILENCE + end) / RATE / speed))
    path.parent.mkdir(parents=True, exist_ok=True)
    rows = np.empty((len(made), len(Stream._fields)), object)
    for row, one in zip(rows, made):
        row[:] = one
    np.save(path, rows, allow_pickle=True)
    return made


# --- Judging


class Judged(NamedTuple):
    stream: Stream
    probabilities: np.ndarray  # float32[steps, 5]


def judge(weights: Weights, heard: Iterable[Stream]) -> list[Judged]:
    made = []
    for one in heard:
        windows = np.lib.stride_tricks.sliding_window_view(one.embeddings.astype(np.float32), WINDOWS, axis=0)
        made.append(Judged(one, network.probabilities(weights, windows.transpose(0, 2, 1))))
    return made


class Rate(NamedTuple):
    hits: float  # whole numbers, but in a mean of several heads
    n: float

    def __str__(self) -> str:
        low, high = wilson(self.hits, self.n)
        return f"{self.hits:g}/{self.n:g} = {self.hits / max(self.n, 1):.3f} ({low:.3f}-{high:.3f})"


def wilson(hits: float, n: float, z: float = 1.96) -> tuple[float, float]:
    """The 95 % interval of a rate."""
    if n == 0:
        return 0.0, 1.0
    p = hits / n
    centre, half = p + z * z / (2 * n), z * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return max(0.0, (centre - half) / (1 + z * z / n)), min(1.0, (centre + half) / (1 + z * z / n))


def poisson(count: float, hours: float) -> tuple[float, float]:
    """The exact 95 % interval of a rate per hour."""
    from scipy.stats import chi2

    low = chi2.ppf(0.025, 2 * count) / 2 if count else 0.0
    return low / hours, chi2.ppf(0.975, 2 * count + 2) / 2 / hours


class Counts(NamedTuple):
    recall: dict[str, Rate]  # by cue: it was the first that was detected
    false_accepts: dict[str, Rate]  # by other word: anything was detected
    confusions: dict[str, list[str]]  # by word said: what wrong cues were detected
    latencies_s: list[float]  # of right detections, after the word's end
    alarms: dict[str, float]  # by cue, in streams without a word
    hours: float  # without the silence around it


def count(judged: Iterable[Judged], rules: Rules, stopped: bool = False) -> Counts:
    said: dict[str, list[int]] = defaultdict(list)
    others: dict[str, list[int]] = defaultdict(list)
    confusions: dict[str, list[str]] = defaultdict(list)
    latencies, hours, alarms = [], 0.0, dict.fromkeys(CUES, 0)
    for one, probabilities in judged:
        found: list[Detection] = detect(rules, probabilities, one.levels, one.periodicities, stopped)
        if one.word in CUES:
            right = bool(found) and found[0].cue == one.word
            said[one.word].append(right)
            confusions[one.word] += [f.cue for f in found if f.cue != one.word]
            if right:
                latencies.append(step_end_s(found[0].step) - one.end_s)
        elif one.word:
            others[one.word].append(bool(found))
            confusions[one.word] += [f.cue for f in found]
        else:
            hours += one.hours
            for f in found:
                alarms[f.cue] += 1
    rate = lambda flags: {word: Rate(sum(f), len(f)) for word, f in sorted(flags.items())}
    return Counts(rate(said), rate(others), {w: c for w, c in confusions.items() if c}, latencies, alarms, hours)


def total(rates: dict[str, Rate]) -> Rate:
    return Rate(sum(r.hits for r in rates.values()), sum(r.n for r in rates.values()))


def mean(counts: list[Counts]) -> Counts:
    """Of several heads that judged the same."""
    k = len(counts)
    rates = lambda of: {word: Rate(sum(c[word].hits for c in of) / k, of[0][word].n) for word in of[0]}
    confusions: dict[str, list[str]] = defaultdict(list)
    for one in counts:
        for word, found in one.confusions.items():
            confusions[word] += found
    return Counts(
        rates([c.recall for c in counts]),
        rates([c.false_accepts for c in counts]),
        dict(confusions),
        [latency for c in counts for latency in c.latencies_s],
        {cue: sum(c.alarms[cue] for c in counts) / k for cue in CUES},
        counts[0].hours,
    )
