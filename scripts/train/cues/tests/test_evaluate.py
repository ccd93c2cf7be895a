import dataclasses

import numpy as np

import evaluate
from evaluate import Heard, Rate
from rules import Rules
from words import LABELS


def heard(word: str, phase: int, label: str, p: float, name: str = "a", fold: int = 0) -> Heard:
    """A word between silence, of which the network makes a label for a fifth of a second."""
    steps = 60
    probabilities = np.zeros((steps, len(LABELS)))
    probabilities[:, LABELS.index("other")] = 1
    probabilities[20:30, LABELS.index("other")] = 1 - p
    probabilities[20:30, LABELS.index(label)] += p
    levels = np.full((steps, 2), -60.0)
    levels[10:25] = -20
    return Heard(name, word, fold, phase, 1.5, 1 / 3600, probabilities, levels, np.full((steps, 2), 0.9))


def test_figures_are_means_over_phases_and_what_depends_on_the_phase_is_told() -> None:
    said = [heard("left", 0, "left", 0.9), heard("left", 80, "left", 0.1)]
    counts = evaluate.count(said, lambda fold: Rules())
    assert counts.recall == {"left": Rate(0.5, 1)} and counts.unsteady == Rate(1, 1)
    assert str(counts.recall["left"]).startswith("0.5/1 = 0.500 (")


def test_go_is_a_forward_and_another_word_that_is_taken_for_a_cue_is_told() -> None:
    counts = evaluate.count([heard("go", 0, "go", 0.9), heard("no", 0, "go", 0.9, "b")], lambda fold: Rules())
    assert counts.recall == {"go": Rate(1, 1)} and counts.false_accepts == {"no": Rate(1, 1)}
    assert counts.taken_for == {"no": {"forward": 1}}


def test_streams_count_alarms_by_the_rules_of_their_fold() -> None:
    never = dataclasses.replace(Rules(), stop=1.1)
    streams = [heard("", 0, "stop", 0.9, fold=0), heard("", 0, "stop", 0.9, "b", fold=1)]
    counts = evaluate.count(streams, lambda fold: never if fold else Rules())
    assert counts.alarms["stop"] == 1 and counts.hours == 2 / 3600
