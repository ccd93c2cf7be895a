"""Plays recordings through network and rules, step by step as the robot hears them, and counts.

A network judges what it has not heard: each recording has a fold, and there is a network without it. Each is played
four times, beginning 5 ms later each time; figures are means over these.
"""

from __future__ import annotations

import math
from collections import defaultdict
from concurrent.futures import ProcessPoolExecutor
from functools import cache, partial
from pathlib import Path
from typing import Callable, Iterable, NamedTuple

import numpy as np

import augment
import features
import network
import sounds
import strangers
import trunk
from features import FRAMES, HOP, LANE_FRAMES, LANES, RATE, STEP_FRAMES, WINDOWS
from network import Weights
from rules import MEANT, Detection, Rules, detect
from sounds import Recording
from synthesise import held_out, load, seed_of
from words import BROADCASTS, CUES, SYNTHETIC_CUES, TEST_ALIKES

# Frames that the head sees of its first step.
SEEN = FRAMES + (WINDOWS - 1) * STEP_FRAMES
# Near-silence before and after a clip. The first frame whose level counts is the clip's own: what is always there is
# then its noise, not ours, beside which all of it would be loud.
SILENCE = (SEEN - LANE_FRAMES - 1) * HOP
# Samples that are left out before a clip begins.
PHASES = (0, 80, 160, 240)


class Network(NamedTuple):
    embedding: bytes  # of trunk.whole
    head: Weights


HEAD_NAMES = {"0": "conv1", "2": "conv2", "6": "dense1", "8": "dense2"}


def parts(path: Path) -> tuple[trunk.Weights, Weights]:
    """Trunk and head of a file of `folds`, without torch."""
    with np.load(path) as file:
        stored = {name: file[name].astype(np.float32) for name in file.files}
    layers = {name.removeprefix("trunk."): value for name, value in stored.items() if name.startswith("trunk.")}
    head = {name: stored[name] for name in ("mean", "deviation")}
    for number, name in HEAD_NAMES.items():
        for kind in ("weight", "bias"):
            head[f"{name}.{kind}"] = stored[f"head.layers.{number}.{kind}"]
    return layers, head


def read(path: Path) -> Network:
    layers, head = parts(path)
    return Network(trunk.whole(layers).SerializeToString(), head)


class Heard(NamedTuple):
    """What a network made of a recording, from one phase on."""

    name: str
    word: str  # empty where it is no single word
    fold: int
    phase: int
    end_s: float  # where the word ends; the length, where there is none
    hours: float  # without the silence around it
    probabilities: np.ndarray  # float32[steps, 6]
    levels: np.ndarray  # float32[steps, 2]
    periodicities: np.ndarray  # likewise


def step_end_s(step: int) -> float:
    """When a step is complete, in seconds of the stream."""
    return (features.HEAD_SPAN + step * LANE_FRAMES * HOP) / RATE


def probabilities(embedding: features.Embedding, head: Weights, mel: np.ndarray) -> np.ndarray:
    """float32[steps, 6] of log-mel float32[frames, 32]: the lanes take turns."""
    steps = max(0, (len(mel) - SEEN) // LANE_FRAMES + 1)
    made = np.zeros((steps, len(head["dense2.bias"])), np.float32)
    for lane in range(min(LANES, steps)):
        embeddings = embedding.of_stretch(mel[lane * LANE_FRAMES :])
        windows = np.lib.stride_tricks.sliding_window_view(embeddings, WINDOWS, axis=0).transpose(0, 2, 1)
        made[lane::LANES] = network.probabilities(head, windows)
    return made


def listen(
    embedding: features.Embedding, head: Weights, audio: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Probabilities, levels and periodicities of each step."""
    mel = features.log_mel(audio)
    found = probabilities(embedding, head, mel)
    newest = SEEN - LANE_FRAMES + LANE_FRAMES * np.arange(len(found))[:, None] + np.arange(LANE_FRAMES)
    return found, augment.levels_db(mel)[newest], features.periodicity(audio)[newest]


# --- Conditions: what is done to a clip (with the silence around it); rng is the clip's own

Condition = Callable[[np.ndarray, np.random.Generator], np.ndarray]


def noisy(snr_db: float, noises: list[np.ndarray] | None = None) -> Condition:
    """Real noise, or a walking robot's by formula."""

    def condition(audio: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        if noises is None:
            noise = sounds.robot(rng, len(audio))
        else:
            noise = sounds.unit(augment.Scene([], []).piece(rng, noises, len(audio)))
        speech = audio[SILENCE:-SILENCE]
        mixed = audio + noise * np.sqrt(augment.power(speech) / 10 ** (snr_db / 10))
        return mixed / max(1.0, float(np.abs(mixed).max()))

    return condition


def babble(snr_db: float) -> Condition:
    """Four who read at once."""

    def condition(audio: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        talk = [r.audio for r in strangers.reading()]
        return noisy(snr_db, [sum(sounds.unit(augment.Scene([], []).piece(rng, talk, len(audio))) for _ in range(4))])(
            audio, rng
        )

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


@cache
def conditions() -> dict[str, Condition]:
    noises = [r.audio for r in sounds.noise()]
    return {
        "clean": lambda audio, rng: audio,
        "noise 20 dB": noisy(20, noises),
        "noise 10 dB": noisy(10, noises),
        "noise 5 dB": noisy(5, noises),
        "noise 0 dB": noisy(0, noises),
        "robot 10 dB": noisy(10),
        "babble 10 dB": babble(10),
        "shouted": shouted,
        "reverb 0.5 s": reverberant(0.5),
        "-35 dBFS": level(-35),
    }


# --- Sets


def held_out_voices() -> list[Recording]:
    """Synthetic voices that never train, every third clip of the many. Besides cues only Festival speaks."""
    made = []
    for family, every in (("kokoro", 1), ("espeak", 3), ("flite", 1), ("festival", 3)):
        spoken = SYNTHETIC_CUES if family != "festival" else None
        wanted = [clip for clip in load(family) if len(clip.audio) and held_out(family, clip.voice)]
        wanted = [clip for clip in wanted if spoken is None or clip.text in spoken]
        for i, clip in enumerate(wanted[::every]):
            made.append(Recording(f"{family}/{clip.text}/{clip.voice}/{i}", clip.text, 0, clip.audio))
    return dealt(made)


def alikes() -> list[Recording]:
    """Words that sound like cues, by synthetic voices that never train."""
    wanted = [clip for clip in load("unheard") if clip.text in TEST_ALIKES]
    return dealt([Recording(f"unheard/{c.text}/{c.voice}", c.text, 0, c.audio) for c in wanted])


def television() -> list[Recording]:
    """Forty seconds each of synthetic voices that never train, two of three over music."""
    said = [clip for clip in load("unheard") if clip.text in BROADCASTS]
    made = []
    for i in range(12 if said else 0):
        rng = np.random.default_rng(seed_of("television test", i))
        audio, at = np.zeros(40 * RATE, np.float32), 0
        while at < len(audio):
            clip = augment.equalised(said[rng.integers(len(said))].audio, rng, 2)[: len(audio) - at]
            audio[at : at + len(clip)] += clip
            at += len(clip) + int(rng.exponential(0.3) * RATE)
        if i % 3:
            under = 10 ** (rng.uniform(-18, -3) / 20) * np.sqrt(augment.power(audio))
            audio = audio + under * sounds.music(rng, len(audio))
        audio = augment.reverberated(augment.clipped(audio, 2), rng, rng.uniform(0.2, 0.6), 0.5)
        audio = audio * 10 ** (rng.uniform(-25, -3) / 20) / float(np.abs(audio).max())
        made.append(Recording(f"television/{i}", "", 0, audio.astype(np.float32)))
    return dealt(made)


def dealt(recordings: list[Recording]) -> list[Recording]:
    """What no network has heard is judged by all of them in turn."""
    return [recording._replace(fold=i % strangers.FOLDS) for i, recording in enumerate(recordings)]


def one_speaker() -> list[Recording]:
    return dealt(sounds.one_speaker())


def noise_levels() -> list[Recording]:
    """Each real noise at three levels, and as many by formula: a robot that walks above all."""
    made = []
    for r in strangers.noise():
        for peak_db in (0, -15, -30):
            audio = r.audio * 10 ** (peak_db / 20) / max(float(np.abs(r.audio).max()), 1e-9)
            made.append(r._replace(name=f"{r.name} {peak_db} dB", audio=audio.astype(np.float32)))
    for i in range(15):
        rng = np.random.default_rng(seed_of("noise test", i))
        audio = sounds.robot(rng, 20 * RATE) if i % 3 else sounds.by_formula(rng, 20 * RATE)
        peak_db = rng.uniform(-30, 0)
        audio = audio * 10 ** (peak_db / 20) / float(np.abs(audio).max())
        made.append(Recording(f"noise/formula {i}", "", i % strangers.FOLDS, audio.astype(np.float32)))
    return made


SETS: dict[str, Callable[[], list[Recording]]] = {
    "words": strangers.words,
    "one speaker": one_speaker,
    "voices": held_out_voices,
    "alikes": alikes,
    "reading": strangers.reading,
    "television": television,
    "noise": noise_levels,
}


# --- Judging


def played(network_of: Network, set_name: str, fold: int, condition: str, phases: tuple[int, ...]) -> list[Heard]:
    """What a network makes of the recordings of a fold."""
    embedding = features.Embedding(network_of.embedding)
    made = []
    for recording in SETS[set_name]():
        if recording.fold != fold:
            continue
        rng = np.random.default_rng(seed_of("evaluate", condition, recording.name))
        end = augment.extent(recording.audio)[1] if recording.word else len(recording.audio)
        audio = np.pad(recording.audio, SILENCE).astype(np.float32)
        audio = audio + np.float32(10 ** (-70 / 20)) * rng.standard_normal(len(audio)).astype(np.float32)
        audio = conditions()[condition](audio, rng).astype(np.float32)
        end_s = (SILENCE + end) / RATE / (1.15 if condition == "shouted" else 1.0)
        for phase in phases:
            heard = listen(embedding, network_of.head, audio[phase:])
            length = len(recording.audio) / RATE / 3600
            made.append(
                Heard(recording.name, recording.word, fold, phase, end_s - phase / RATE, length, *heard)
            )
    return made


def played_by_all(
    networks: dict[int, Network], set_name: str, condition: str = "clean", phases: tuple[int, ...] = PHASES
) -> list[Heard]:
    """Each recording by the network that has not heard it, in two processes."""
    one = partial(played_of_fold, networks, set_name, condition, phases)
    with ProcessPoolExecutor(2) as processes:
        return [heard for of_fold in processes.map(one, networks) for heard in of_fold]


def played_of_fold(
    networks: dict[int, Network], set_name: str, condition: str, phases: tuple[int, ...], fold: int
) -> list[Heard]:
    return played(networks[fold], set_name, fold, condition, phases)


class Rate(NamedTuple):
    hits: float  # whole numbers, but in a mean over phases
    n: float

    def __str__(self) -> str:
        low, high = wilson(self.hits, self.n)
        return f"{self.hits:.4g}/{self.n:g} = {self.hits / max(self.n, 1):.3f} ({low:.3f}-{high:.3f})"


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
    recall: dict[str, Rate]  # by cue as it is said: what it means was the first that was detected
    false_accepts: dict[str, Rate]  # by other word: anything was detected
    taken_for: dict[str, dict[str, float]]  # by word said: how often what else was detected
    latencies_s: list[float]  # of right detections, after the word's end
    alarms: dict[str, float]  # by cue, in streams without a word
    hours: float  # without the silence around it
    unsteady: Rate  # clips that are not decided alike in all phases


def meant(word: str) -> str:
    return MEANT.get(word, word)


def count(judged: Iterable[Heard], rules_of: Callable[[int], Rules], stopped: bool = False) -> Counts:
    """Means over the phases. The rules may depend on the fold."""
    said: dict[str, dict[str, list[bool]]] = defaultdict(lambda: defaultdict(list))
    outcomes: dict[str, set[tuple[str, ...]]] = defaultdict(set)
    taken: dict[str, dict[str, float]] = defaultdict(lambda: defaultdict(float))
    latencies, hours, alarms, phases = [], 0.0, defaultdict(float), set()
    for heard in judged:
        phases.add(heard.phase)
        found: list[Detection] = detect(
            rules_of(heard.fold), heard.probabilities, heard.levels, heard.periodicities, stopped
        )
        outcomes[heard.name].add(tuple(f.cue for f in found[:1]))
        if heard.word in CUES:
            right = bool(found) and found[0].cue == meant(heard.word)
            said[heard.word][heard.name].append(right)
            if right:
                latencies.append(step_end_s(found[0].step) - heard.end_s)
        elif heard.word:
            said[heard.word][heard.name].append(bool(found))
        else:
            hours += heard.hours
            for f in found:
                alarms[f.cue] += 1
        if heard.word:
            for f in found:
                if f.cue != meant(heard.word):
                    taken[heard.word][f.cue] += 1
    many = max(len(phases), 1)
    rates = {w: Rate(sum(float(np.mean(clip)) for clip in clips.values()), len(clips)) for w, clips in said.items()}
    of = lambda cues: {word: rates[word] for word in sorted(rates) if (word in CUES) == cues}
    wrong = {word: {cue: n / many for cue, n in cues.items()} for word, cues in taken.items()}
    unsteady = Rate(sum(len(found) > 1 for found in outcomes.values()), len(outcomes))
    each = {cue: alarms[cue] / many for cue in SYNTHETIC_CUES}
    return Counts(of(True), of(False), wrong, latencies, each, hours / many, unsteady)


def total(rates: dict[str, Rate]) -> Rate:
    return Rate(sum(r.hits for r in rates.values()), sum(r.n for r in rates.values()))
