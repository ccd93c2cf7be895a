"""Training windows for a network that is trained end to end: log-mel sequences in build/mels.

A sequence is float16[172, 32]. A group is made in parts, so that many processes share the work.
"""

from __future__ import annotations

import argparse
import sys
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import cache
from typing import Callable, Iterator, NamedTuple

import numpy as np

import features
import sounds
import strangers
import windows
from augment import SHIFTS, STEPS
from synthesise import BUILD
from windows import ALIKES, Example, Stretch, is_cue
from words import CUES

# Frames of a sequence.
FRAMES = features.FRAMES + (STEPS - 1) * features.STEP_FRAMES

class Group(NamedTuple):
    sequences: np.ndarray  # float16[n, 172, 32]
    labels: np.ndarray  # int8[n]
    folds: np.ndarray  # int8[n]


Part = Callable[[], Iterator[Example | Stretch]]


@cache
def said(cues: bool) -> list[sounds.Recording]:
    return [recording for recording in strangers.words() if (recording.word in CUES) == cues]


def is_alike(text: str) -> bool:
    return text in ALIKES


def is_word(text: str) -> bool:
    return not is_cue(text) and not is_alike(text)


def is_other(text: str) -> bool:
    return not is_cue(text)


# In what proportion the groups are drawn, in how many parts each is made, and how a part is made.
SYNTHETIC: dict[str, tuple[float, int, str, Callable[[str], bool], bool]] = {
    "cues_kokoro": (0.12, 6, "kokoro", is_cue, False),
    "cues_kokoro_hard": (0.05, 3, "kokoro", is_cue, True),
    "cues_espeak": (0.03, 3, "espeak", is_cue, False),
    "cues_espeak_hard": (0.01, 1, "espeak", is_cue, True),
    "cues_accents": (0.05, 3, "accents", is_cue, False),
    "cues_accents_hard": (0.02, 2, "accents", is_cue, True),
    "cues_flite": (0.02, 3, "flite", is_cue, False),
    "alikes_kokoro": (0.05, 4, "kokoro", is_alike, False),
    "alikes_espeak": (0.02, 3, "espeak", is_alike, False),
    "alikes_flite": (0.01, 1, "flite", is_alike, False),
    "alikes_accents": (0.02, 2, "accents", is_other, False),
    "words_kokoro": (0.03, 2, "kokoro", is_word, False),
    "words_kokoro_hard": (0.02, 1, "kokoro", is_other, True),
    "words_espeak": (0.01, 1, "espeak", is_word, False),
    "words_flite": (0.01, 1, "flite", is_word, False),
}
REAL: dict[str, tuple[float, int, bool, bool]] = {
    "cues_real": (0.20, 12, True, False),
    "cues_real_hard": (0.08, 8, True, True),
    "words_real": (0.16, 8, False, False),
    "words_real_hard": (0.06, 4, False, True),
}
STREAMS: dict[str, tuple[float, int, Callable[[int], Iterator[Example | Stretch]]]] = {
    "partial": (0.02, 1, lambda part: windows.partial("kokoro", 1)),
    "reading": (0.10, 4, lambda part: windows.streams(strangers.reading(), 1, first=part)),
    "reading_others": (0.08, 4, lambda part: windows.streams(strangers.reading(), 1, gentle=False, first=part)),
    "prompts": (0.05, 2, lambda part: windows.streams(sounds.prompts()[part::2], 1)),
    "noise": (0.04, 1, lambda part: windows.noises(strangers.noise(), 8)),
    "babble": (0.02, 1, lambda part: windows.babble(strangers.reading(), 160)),
    "robots": (0.03, 1, lambda part: windows.robots(150)),
    "television": (0.10, 4, lambda part: windows.television(150, first=150 * part)),
    "backgrounds": (0.05, 1, lambda part: windows.backgrounds(3000)),
}


def parts() -> dict[tuple[str, int], Part]:
    made: dict[tuple[str, int], Part] = {}
    for name, (_, count, family, wanted, hard) in SYNTHETIC.items():
        for k in range(count):
            made[name, k] = lambda f=family, w=wanted, h=hard, k=k: windows.synthetic(f, w, 1, h, first=k)
    for name, (_, count, cues, hard) in REAL.items():
        for k in range(count):
            made[name, k] = lambda c=cues, h=hard, k=k: windows.real(said(c), 1, h, first=k)
    for name, (_, count, make_part) in STREAMS.items():
        for k in range(count):
            made[name, k] = lambda m=make_part, k=k: m(k)
    return made


def share_of(name: str) -> float:
    return {**SYNTHETIC, **REAL, **STREAMS}[name][0]


def path_of(name: str, part: int):
    return BUILD / "mels" / f"{name}-{part}.npz"


def cut(example: Example | Stretch) -> Iterator[np.ndarray]:
    last = len(example.heard) - FRAMES
    for start in range(0, last + 1, SHIFTS * features.STEP_FRAMES):
        yield example.heard[start : start + FRAMES].astype(np.float16)


def make(key: tuple[str, int]) -> str:
    """Writes a part's sequences: log-mel float16[n, 172, 32], labels int8[n], folds int8[n]."""
    began = time.monotonic()
    sequences, labels, folds = [], [], []
    for example in parts()[key]():
        found = list(cut(example))
        sequences += found
        labels += [example.label] * len(found)
        folds += [example.fold] * len(found)
    if not sequences:
        return f"{key}: none, its sounds are missing"
    path = path_of(*key)
    path.parent.mkdir(parents=True, exist_ok=True)
    fresh = path.with_suffix(".new.npz")
    np.savez(fresh, sequences=np.stack(sequences), labels=np.array(labels, np.int8), folds=np.array(folds, np.int8))
    fresh.replace(path)
    return f"{key}: {len(labels)} sequences, {time.monotonic() - began:.0f} s"


def groups() -> Iterator[tuple[str, Group]]:
    """Each part that was made, with its group's name."""
    for name, part in parts():
        if path_of(name, part).exists():
            with np.load(path_of(name, part)) as file:
                yield name, Group(file["sequences"], file["labels"], file["folds"])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="groups; all without it")
    parser.add_argument("--processes", type=int, default=2)
    arguments = parser.parse_args()
    wanted = [key for key in parts() if not path_of(*key).exists() and key[0] in (arguments.names or [key[0]])]
    # The long ones first.
    wanted.sort(key=lambda key: -(("real" in key[0]) * 2 + ("kokoro" in key[0])))
    with ProcessPoolExecutor(arguments.processes) as pool:
        for done in as_completed([pool.submit(make, key) for key in wanted]):
            print(done.result(), file=sys.stderr)


if __name__ == "__main__":
    main()
