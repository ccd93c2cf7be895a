import evaluate
from evaluate import Counts, Rate
from words import CUES


def counts(hits: int, alarms: int) -> Counts:
    quiet = dict.fromkeys(CUES, 0)
    wrong = {"dog": ["stop"]} if alarms else {}
    return Counts({"left": Rate(hits, 10)}, {"dog": Rate(alarms, 10)}, wrong, [0.1], quiet | {"stop": alarms}, 0.5)


def test_the_mean_of_heads_is_of_the_same_recordings() -> None:
    both = evaluate.mean([counts(8, 0), counts(9, 1)])
    assert both.recall == {"left": Rate(8.5, 10)} and both.false_accepts == {"dog": Rate(0.5, 10)}
    assert both.alarms["stop"] == 0.5 and both.hours == 0.5
    assert both.confusions == {"dog": ["stop"]} and both.latencies_s == [0.1, 0.1]
    assert str(both.recall["left"]).startswith("8.5/10 = 0.850 (")
