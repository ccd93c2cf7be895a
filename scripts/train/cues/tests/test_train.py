"""How thresholds are chosen, on rows that are easily seen through."""

import math

import train


def row(threshold: float, words: float = math.nan, speaker: float = math.nan, accepts: float = 0.0) -> dict[str, float]:
    return {
        "threshold": threshold,
        "words": words,
        "speaker": speaker,
        "voices": 1.0,
        "accepts": accepts,
        "reading": 0.0,
        "noise": 0.0,
    }


def test_forward_is_taken_to_be_found_in_real_voices_as_often_as_the_other_directions() -> None:
    rows = {"forward": [row(0.5)], "left": [row(0.5, 0.6, 0.4)], "right": [row(0.5, 1.0, 0.8)], "stop": [row(0.5, 1, 1)]}
    train.lend_real_voices(rows)
    assert math.isclose(rows["forward"][0]["words"], 0.8) and math.isclose(rows["forward"][0]["speaker"], 0.6)
    assert rows["left"][0]["words"] == 0.6


def test_after_a_stop_forward_needs_what_nothing_else_reaches() -> None:
    rows = [row(0.5), row(0.6), row(0.7, accepts=0.1), row(0.8), row(0.9)]
    assert train.strictest(rows, 0.5) == 0.6
    assert train.strictest(rows, 0.6) == 0.8
    assert train.strictest([row(0.6, accepts=0.1)], 0.5) == 0.9
