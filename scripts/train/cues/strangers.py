"""The real recordings in five folds of speakers, for a network that is trained end to end.

A network of fold k has not heard the speakers of fold k. The one of fold 0 is shipped: 30 speakers have not trained it.
The one speaker trains none of them.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import sounds
from sounds import DATA, Recording, read

FOLDS = 5
SETS = ("speech_commands", "speech_commands_v2")


def speaker_of(path: Path) -> str:
    return path.name.split("_")[0]


def dealt(paths: list[Path]) -> dict[str, int]:
    """The fold of each speaker: who has most clips first, each to the smallest fold."""
    sizes, fold_of = [0] * FOLDS, {}
    for speaker, count in sorted(Counter(map(speaker_of, paths)).items(), key=lambda item: (-item[1], item[0])):
        smallest = sizes.index(min(sizes))
        fold_of[speaker] = smallest
        sizes[smallest] += count
    return fold_of


def words() -> list[Recording]:
    """Clips of single words by 151 speakers."""
    paths = [path for name in SETS for path in sorted((DATA / name).glob("*/*_nohash_*"))]
    fold_of = dealt(paths)
    return [Recording("/".join(p.parts[-3:]), p.parent.name, fold_of[speaker_of(p)], read(p)) for p in paths]


def refolded(recordings: list[Recording]) -> list[Recording]:
    """One file a speaker, or a noise each."""
    return [recording._replace(fold=i % FOLDS) for i, recording in enumerate(recordings)]


def reading() -> list[Recording]:
    return refolded(sounds.librispeech())


def noise() -> list[Recording]:
    return refolded(sounds.noise())
