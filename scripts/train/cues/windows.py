"""Training windows: clips, put into scenes, as log-mel."""

from __future__ import annotations

from functools import cache
from typing import Callable, Iterator, NamedTuple

import numpy as np

import features
import sounds
from augment import SPAN, Scene, clipped, equalised, extent, power
from features import RATE
from sounds import TEST_FOLD
from synthesise import Clip, held_out, load, seed_of
from words import CUES, LABELS, SENTENCES, SOUND_ALIKES, STOP_PHRASES

OTHER = LABELS.index("other")
ALIKES = {word for words in SOUND_ALIKES.values() for word in words}


class Example(NamedTuple):
    label: int
    fold: int  # of the recording it comes from; -1: none that is ever kept back
    heard: np.ndarray  # log-mel float32[172, 32]


class Stretch(NamedTuple):
    """A long one, to be cut so that each window is in one sequence."""

    label: int
    fold: int
    heard: np.ndarray  # log-mel float32[frames, 32]


@cache
def scene() -> Scene:
    noises = [r.audio for r in sounds.noise() if r.fold != TEST_FOLD]
    talk = [r.audio for r in sounds.librispeech() if r.fold != TEST_FOLD] + [r.audio for r in sounds.prompts()]
    return Scene(noises, talk)


@cache
def clips(family: str) -> list[Clip]:
    return [clip for clip in load(family) if not held_out(family, clip.voice) and len(clip.audio) > RATE // 10]


def label_of(text: str) -> int:
    if text in STOP_PHRASES:
        return LABELS.index("stop")
    return LABELS.index(text) if text in CUES else OTHER


def spoken(clip: Clip, rng: np.random.Generator, hard: bool) -> Example:
    """A synthetic word; of a sentence some stretch."""
    audio = scene().voice(clip.audio, rng)
    end = extent(audio)[1]
    if clip.text in SENTENCES:
        end = int(rng.integers(RATE // 4, len(audio)))
    placed = scene().placed(audio, end, rng, context=rng.random() < 0.2)
    return Example(label_of(clip.text), -1, scene().mel(scene().heard(placed, rng, hard=hard)))


def synthetic(
    family: str, wanted: Callable[[str], bool], times: int, hard: bool = False, first: int = 0
) -> Iterator[Example]:
    for i, clip in enumerate(clips(family)):
        if wanted(clip.text):
            for k in range(first, first + times):
                seed = seed_of("spoken", family, i, k, *(["hard"] if hard else []))
                yield spoken(clip, np.random.default_rng(seed), hard)


def is_cue(text: str) -> bool:
    return label_of(text) != OTHER


def partial(family: str, times: int) -> Iterator[Example]:
    """A cue of which not even half has been heard: no cue yet."""
    for i, clip in enumerate(clips(family)):
        if clip.text in CUES:
            for k in range(times):
                rng = np.random.default_rng(seed_of("partial", family, i, k))
                audio = scene().voice(clip.audio, rng)
                start, end = extent(audio)
                audio = audio[: start + int(rng.uniform(0.2, 0.45) * (end - start))]
                placed = np.zeros(SPAN, np.float32)
                audio = audio[-SPAN:]
                placed[SPAN - len(audio) :] = audio
                yield Example(OTHER, -1, scene().mel(scene().heard(placed, rng)))


def real(recordings: list[sounds.Recording], times: int, hard: bool = False, first: int = 0) -> Iterator[Example]:
    for recording in recordings:
        for k in range(first, first + times):
            rng = np.random.default_rng(seed_of("real", recording.name, k, *(["hard"] if hard else [])))
            audio = scene().voice(recording.audio, rng, gentle=True) if k else recording.audio
            placed = scene().placed(audio, extent(audio)[1], rng, context=rng.random() < 0.1)
            label, quiet = label_of(recording.word), rng.random() < 0.4
            yield Example(label, recording.fold, scene().mel(scene().heard(placed, rng, quiet, hard)))


def streams(
    recordings: list[sounds.Recording], times: int, gentle: bool = True, first: int = 0
) -> Iterator[Stretch]:
    """Running speech."""
    for recording in recordings:
        for k in range(first, first + times):
            rng = np.random.default_rng(seed_of("stream", recording.name, k, gentle))
            audio = scene().voice(recording.audio, rng, gentle)
            audio = scene().heard(audio, rng, quiet=rng.random() < 0.5)
            # A sentence or a prompt begins and ends in silence, if it is not cut short.
            audio = np.pad(audio, (RATE if rng.random() < 0.5 else 0, RATE // 2))
            audio += 10 ** (rng.uniform(-90, -60) / 20) * rng.standard_normal(len(audio)).astype(np.float32)
            yield Stretch(OTHER, recording.fold, features.log_mel(audio))


def backgrounds(count: int) -> Iterator[Example]:
    """Nobody speaks; some of it begins suddenly."""
    for i in range(count):
        rng = np.random.default_rng(seed_of("background", i))
        audio = scene().background(rng, SPAN)
        if rng.random() < 0.5:
            audio = audio * (np.arange(SPAN) > rng.integers(0, SPAN))
        if rng.random() < 0.3:
            audio = audio + rng.uniform(0, 1) * scene().background(rng, SPAN)
        audio = audio * 10 ** (rng.uniform(-60, 0) / 20) / max(float(np.abs(audio).max()), 1e-6)
        if rng.random() < 0.02:
            audio = np.zeros(SPAN)
        yield Example(OTHER, -1, scene().mel(audio.astype(np.float32)))


def noises(recordings: list[sounds.Recording], times: int) -> Iterator[Stretch]:
    """Real noise that comes and goes, all of it."""
    for recording in recordings:
        for k in range(times):
            rng = np.random.default_rng(seed_of("noise", recording.name, k))
            audio = equalised(recording.audio, rng, rng.uniform(0, 4))
            at, gain = 0, np.zeros(len(audio), np.float32)
            while at < len(audio):
                length = int(rng.exponential(1.5) * RATE) + RATE // 10
                gain[at : at + length] = rng.choice([0.0, 0.001, 1.0, 1.0]) * 10 ** (rng.uniform(-20, 0) / 20)
                at += length
            audio = audio * gain * 10 ** (rng.uniform(-40, 0) / 20) / float(np.abs(audio).max())
            audio = audio + 10 ** (rng.uniform(-90, -50) / 20) * rng.standard_normal(len(audio)).astype(np.float32)
            yield Stretch(OTHER, recording.fold, features.log_mel(audio.astype(np.float32)))


def robots(count: int) -> Iterator[Stretch]:
    """Twenty seconds each of sounds by formula, a walking robot's above all, alone or over real noise."""
    for i in range(count):
        rng = np.random.default_rng(seed_of("robots", i))
        audio = sounds.robot(rng, 20 * RATE) if rng.random() < 0.5 else sounds.by_formula(rng, 20 * RATE)
        if rng.random() < 0.4:
            audio = audio + rng.uniform(0.1, 1.5) * scene().background(rng, len(audio))
        audio = equalised(audio, rng, rng.uniform(0, 4))
        audio = audio * 10 ** (rng.uniform(-35, 0) / 20) / float(np.abs(audio).max())
        yield Stretch(OTHER, -1, features.log_mel(audio.astype(np.float32)))


def babble(read: list[sounds.Recording], count: int) -> Iterator[Stretch]:
    """Two to five who read at once, all of one fold, in a room."""
    folds = 1 + max((r.fold for r in read), default=0)
    for i in range(count if read else 0):
        rng = np.random.default_rng(seed_of("babble", i))
        fold = i % folds
        talk = [r.audio for r in read if r.fold == fold]
        audio = np.zeros(12 * RATE, np.float32)
        for _ in range(rng.integers(2, 6)):
            gain = 10 ** (rng.uniform(-12, 0) / 20)
            audio += np.float32(gain) * sounds.unit(scene().piece(rng, talk, len(audio)))
        yield Stretch(OTHER, fold, features.log_mel(scene().heard(audio, rng)))


def television(count: int, first: int = 0) -> Iterator[Stretch]:
    """Twenty seconds each of many voices that speak in turn, mostly over music, out of a box that compresses them."""
    talks = lambda family, clip: family == "talk" or clip.text in SENTENCES
    families = [[clip for clip in clips(f) if talks(f, clip)] for f in ("talk", "kokoro", "espeak")]
    for i in range(first, first + count if all(families) else first):
        rng = np.random.default_rng(seed_of("television", i))
        audio, at = np.zeros(20 * RATE, np.float32), int(rng.uniform(0, 1) * RATE)
        while at < len(audio):
            sentences = families[rng.choice(3, p=[0.7, 0.2, 0.1])]
            said = scene().voice(sentences[rng.integers(len(sentences))].audio, rng, gentle=True)[: len(audio) - at]
            audio[at : at + len(said)] += np.float32(10 ** (rng.uniform(-8, 0) / 20)) * said
            at += len(said) + int(rng.exponential(0.3) * RATE)
        yield Stretch(OTHER, -1, features.log_mel(broadcast(audio, rng)))


def broadcast(audio: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """What speech sounds like from a television in a room."""
    if rng.random() < 0.7:
        under_db = rng.uniform(-20, 0)
        audio = audio + np.float32(10 ** (under_db / 20) * np.sqrt(power(audio))) * sounds.music(rng, len(audio))
    return scene().heard(clipped(audio, rng.uniform(1, 4)), rng, quiet=True)
