"""Makes the training windows: clips, put into scenes, as sequences of embeddings in build/windows.

A sequence is float16[13, 96]: six windows of eight embeddings, 80 ms apart, all with the same label. A group is one
kind of sound; training says how often each is drawn.
"""

from __future__ import annotations

import argparse
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from pathlib import Path
from typing import Callable, Iterator, NamedTuple

import numpy as np

import features
import sounds
from augment import SHIFTS, SPAN, STEPS, Scene, equalised, extent
from features import RATE
from sounds import TEST_FOLD
from synthesise import BUILD, Clip, held_out, load, seed_of
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
def embedding() -> features.Embedding:
    return features.Embedding()


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


def speaker(cues: bool) -> list[sounds.Recording]:
    """The one speaker's clips. Only the head that is shipped hears them: those that are judged have not heard him."""
    return [r._replace(fold=sounds.SPEAKER_FOLD) for r in sounds.one_speaker() if (r.word in CUES) == cues]


def commands(cues: bool) -> list[sounds.Recording]:
    return [r for r in sounds.speech_commands() if (r.word in CUES) == cues]


GROUPS: dict[str, Callable[[], Iterator[Example | Stretch]]] = {
    "cues_kokoro": lambda: synthetic("kokoro", is_cue, 8),
    "cues_espeak": lambda: synthetic("espeak", is_cue, 2),
    "cues_flite": lambda: synthetic("flite", is_cue, 4),
    "cues_accents": lambda: synthetic("accents", is_cue, 3),
    "cues_real": lambda: real(commands(True), 200),
    "alikes_kokoro": lambda: synthetic("kokoro", lambda text: text in ALIKES, 4),
    "alikes_espeak": lambda: synthetic("espeak", lambda text: text in ALIKES, 2),
    "alikes_flite": lambda: synthetic("flite", lambda text: text in ALIKES, 1),
    "alikes_accents": lambda: synthetic("accents", lambda text: not is_cue(text), 3),
    "words_kokoro": lambda: synthetic("kokoro", lambda text: not is_cue(text) and text not in ALIKES, 3),
    "words_espeak": lambda: synthetic("espeak", lambda text: not is_cue(text) and text not in ALIKES, 1),
    "words_flite": lambda: synthetic("flite", lambda text: not is_cue(text) and text not in ALIKES, 1),
    "words_real": lambda: real(commands(False), 40),
    "cues_kokoro_hard": lambda: synthetic("kokoro", is_cue, 4, hard=True),
    "cues_espeak_hard": lambda: synthetic("espeak", is_cue, 1, hard=True),
    "cues_accents_hard": lambda: synthetic("accents", is_cue, 2, hard=True),
    "cues_real_hard": lambda: real(commands(True), 100, hard=True),
    "words_kokoro_hard": lambda: synthetic("kokoro", lambda text: not is_cue(text), 2, hard=True),
    "words_real_hard": lambda: real(commands(False), 20, hard=True),
    "cues_speaker": lambda: real(speaker(True), 40),
    "words_speaker": lambda: real(speaker(False), 12),
    "babble": lambda: babble(sounds.librispeech(), 160),
    "robots": lambda: robots(150),
    "partial": lambda: partial("kokoro", 2),
    "reading": lambda: streams(sounds.librispeech(), 4),
    "reading_others": lambda: streams(sounds.librispeech(), 4, gentle=False),
    "prompts": lambda: streams(sounds.prompts(), 1),
    "noise": lambda: noises(sounds.noise(), 8),
    "backgrounds": lambda: backgrounds(5000),
}


def path_of(group: str) -> Path:
    return BUILD / "windows" / f"{group}.npz"


def make(group: str) -> str:
    """Writes a group's sequences: embeddings float16[n, 13, 96], labels int8[n], folds int8[n]."""
    began = time.monotonic()
    sequences, labels, folds, batch = [], [], [], []

    def embed() -> None:
        if batch:
            sequences.append(embedding().of_mel(np.stack(batch)).astype(np.float16))
            batch.clear()

    for example in GROUPS[group]():
        if isinstance(example, Stretch):
            embed()
            embeddings = embedding().of_mel(example.heard)
            cut = [embeddings[start : start + STEPS] for start in range(0, len(embeddings) - STEPS + 1, SHIFTS)]
            sequences += [one[None].astype(np.float16) for one in cut]
            labels += [example.label] * len(cut)
            folds += [example.fold] * len(cut)
            continue
        labels.append(example.label)
        folds.append(example.fold)
        batch.append(example.heard)
        if len(batch) == 32:
            embed()
    embed()
    if not sequences:
        return f"{group}: none, its sounds are missing"
    path_of(group).parent.mkdir(parents=True, exist_ok=True)
    fresh = path_of(group).with_suffix(".new.npz")
    np.savez(
        fresh, sequences=np.concatenate(sequences), labels=np.array(labels, np.int8), folds=np.array(folds, np.int8)
    )
    fresh.replace(path_of(group))
    return f"{group}: {len(labels)} sequences, {time.monotonic() - began:.0f} s"


class Group(NamedTuple):
    sequences: np.ndarray  # float16[n, 13, 96]
    labels: np.ndarray  # int8[n]
    folds: np.ndarray  # int8[n]


def group(name: str) -> Group | None:
    if not path_of(name).exists():
        return None
    with np.load(path_of(name)) as file:
        return Group(file["sequences"], file["labels"], file["folds"])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("groups", nargs="*", default=list(GROUPS))
    parser.add_argument("--processes", type=int, default=2)
    arguments = parser.parse_args()
    missing = [name for name in arguments.groups if not path_of(name).exists()]
    with ProcessPoolExecutor(arguments.processes) as pool:
        for line in pool.map(make, missing):
            print(line, file=sys.stderr)


if __name__ == "__main__":
    main()
