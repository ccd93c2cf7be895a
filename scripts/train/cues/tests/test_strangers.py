"""Speakers are dealt to folds, never their clips."""

from pathlib import Path

import strangers


def test_a_speaker_is_in_one_fold_and_folds_are_alike() -> None:
    clips = [Path(f"stop/{speaker:08x}_nohash_{i}.wav") for speaker in range(40) for i in range(1 + speaker % 7)]
    fold_of = strangers.dealt(clips)
    assert len(fold_of) == 40 and set(fold_of.values()) == set(range(strangers.FOLDS))
    sizes = [sum(fold_of[strangers.speaker_of(p)] == fold for p in clips) for fold in range(strangers.FOLDS)]
    assert max(sizes) - min(sizes) <= 2
    assert strangers.dealt(clips[::-1]) == fold_of
