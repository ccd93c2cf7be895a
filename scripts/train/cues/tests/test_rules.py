import numpy as np
import pytest

from golden import cases
from rules import FRAMES, Recogniser, Rules

EXPECTED = {
    "a lone direction, reported once it is quiet": ["left"],
    "80 ms are none": [],
    "a direction in running speech is dropped": [],
    "a direction at the end of running speech is dropped": [],
    "a direction that is never followed by quiet is dropped": [],
    "stop in running speech, and not again within a second": ["stop", "stop"],
    "stop ends what waits": ["stop"],
    "forward after a stop needs more": ["stop", "forward", "forward"],
    "another direction within a second is not reported": ["left", "right"],
    "levels that never rise: nobody has spoken": [],
    "a clatter is no voice, and no direction": [],
    "a stop needs no voice": ["stop"],
    "in talk no direction is given, and a stop has to be surer for longer; after six seconds all is as before": [
        "stop",
        "left",
        "stop",
    ],
    "in talk a stop in doubt counts when it is said again": ["stop"],
    "in talk a stop in doubt does not count when it flickers, or is said again much later": [],
    "a stop in doubt ends what waits": [],
    "a voice that is softer than the word by the depth is talk": [],
    "a voice that is softer than that is no talk": ["left"],
    "a noise before a stop is no talk": ["stop"],
    "a direction that waits already as talk begins is given": ["left"],
    "a voice that is as loud as what is always there is no direction": [],
}


@pytest.mark.parametrize("case", cases(), ids=lambda case: case["name"])
def test_a_stream_by_hand(case: dict) -> None:
    assert [found["cue"] for found in case["detections"]] == EXPECTED[case["name"]]


def test_the_floor_falls_fast_and_rises_slowly() -> None:
    recogniser = Recogniser()
    for level in [-20.0] * 100 + [-60.0] * 30:
        recogniser.hear_level(level)
    assert recogniser.floor == pytest.approx(-60, abs=0.1)
    for level in [-20.0] * 100:
        recogniser.hear_level(level)
    assert recogniser.floor == pytest.approx(-60 + 100 * Rules().floor_rise_db, abs=0.1)


LEFT, NOTHING = np.array([0, 0.9, 0, 0, 0, 0.1]), np.array([0, 0, 0, 0, 0, 1.0])


def candidate(levels: list[float]) -> Recogniser:
    """A recogniser that heard levels, whole steps of them, and in the last five steps a "left"."""
    recogniser = Recogniser()
    rows, voiced = np.array(levels).reshape(-1, FRAMES), np.full(FRAMES, 0.9)
    recogniser.found = [
        f for i, row in enumerate(rows) for f in recogniser.hear(LEFT if i >= len(rows) - 5 else NOTHING, row, voiced)
    ]
    return recogniser


def test_a_candidate_waits_for_quiet_and_not_longer() -> None:
    quiet = round(Rules().quiet_s * 100)
    recogniser = candidate([-60.0] * 80 + [-20.0] * (40 - quiet + 1) + [-60.0] * (quiet - 1))
    assert recogniser.found == [] and recogniser.waiting is not None
    assert [f.cue for f in recogniser.hear(NOTHING, np.full(FRAMES, -60.0), np.zeros(FRAMES))] == ["left"]
    assert [f.cue for f in candidate([-60.0] * 80 + [-20.0] * (40 - quiet) + [-60.0] * quiet).found] == ["left"]


def test_a_segment_may_be_as_long_as_the_rule_says_and_no_longer() -> None:
    longest = round(Rules().segment_max_s * 100)
    for length, cues in ((longest, ["left"]), (longest + 1, [])):
        levels = [-60.0] * (240 - length - 24) + [-20.0] * length + [-60.0] * 24
        assert [f.cue for f in candidate(levels).found] == cues


def test_a_steady_noise_that_has_begun_does_not_lengthen_a_word() -> None:
    """It is far above the floor, but as far below the word."""
    levels = [-80.0] * 80 + [-50.0] * 100 + [-20.0] * 36 + [-50.0] * 24
    assert [f.cue for f in candidate(levels).found] == ["left"]


def test_as_much_talk_as_the_rule_says_is_talk_and_less_is_none() -> None:
    """It counts within six seconds, and what is as new as the word itself is no part of it."""
    rules = Rules()
    least, reach, talk = (round(100 * s) for s in (rules.talk_voiced_s, rules.reach_s, rules.talk_s))
    for before, after, is_talk in (
        (least, reach, True),
        (least - 2, reach, False),
        (least, reach - 2, False),
        (least, talk - least, True),
        (least, talk - least + 2, False),
    ):
        recogniser = Recogniser()
        for level, count in ((-60.0, 20), (-20.0, before), (-60.0, after)):
            for _ in range(count // FRAMES):
                recogniser.hear(NOTHING, np.full(FRAMES, level), np.full(FRAMES, 0.9 if level > -40 else 0.0))
        assert recogniser.in_talk() == is_talk, (before, after)
