import numpy as np
import pytest

from golden import cases
from rules import Levels, Rules

EXPECTED = {
    "a lone direction, reported once it is quiet": ["left"],
    "one window is none": [],
    "a direction in running speech is dropped": [],
    "a direction at the end of running speech is dropped": [],
    "a direction that is never followed by quiet is dropped": [],
    "stop in running speech, and not again within a second": ["stop", "stop"],
    "stop ends what waits": ["stop"],
    "forward after a stop needs more": ["stop", "forward", "forward"],
    "another direction within a second is not reported": ["left", "right"],
    "levels that never rise: nothing is known of running speech": ["left"],
}


@pytest.mark.parametrize("case", cases(), ids=lambda case: case["name"])
def test_a_stream_by_hand(case: dict) -> None:
    assert [found["cue"] for found in case["detections"]] == EXPECTED[case["name"]]


def test_the_floor_falls_fast_and_rises_slowly() -> None:
    levels = Levels(Rules())
    for level in [-20.0] * 100 + [-60.0] * 30:
        levels.hear(level)
    assert levels.floor == pytest.approx(-60, abs=0.1)
    for level in [-20.0] * 100:
        levels.hear(level)
    assert levels.floor == pytest.approx(-60 + 100 * Rules().floor_rise_db, abs=0.1)
    assert levels.open and levels.length_s == pytest.approx(1.0)


def test_a_segment_closes_after_the_quiet_and_not_before() -> None:
    rules = Rules()
    levels = Levels(rules)
    for level in [-60.0] * 50 + [-20.0] * 30:
        levels.hear(level)
    quiet = round(rules.quiet_s * 100)
    for _ in range(quiet - 1):
        levels.hear(-60.0)
    assert levels.open
    levels.hear(-60.0)
    assert not levels.open and levels.length_s == pytest.approx(0.3)
