"""How thresholds are chosen, on recordings that are easily seen through."""

import tomllib

from export import rules_table, toml
from rules import DIRECTIONS, STARTS, Rules
from ship import CONFIG, SUREST, SURER, Sweep
from test_evaluate import heard


def test_the_strictest_threshold_that_finds_enough_is_chosen() -> None:
    words = [heard("left", 0, "left", 0.72, "a"), heard("cat", 0, "left", 0.52, "b")]
    quiet = [heard("", 0, "left", 0.0, "c")]
    sweep = Sweep({"words": words, "reading": quiet, "television": quiet, "noise": quiet}, Rules())
    assert sweep.strictest("left", {0}) == 0.7
    assert list(sweep.share("left", {0}, True)[:9]) == [1.0] * 9 and sweep.share("left", {0}, True)[9] == 0
    assert list(sweep.share("left", {0}, False)[4:6]) == [1.0, 0.0], "the cat"


def test_after_a_stop_a_word_has_to_be_surer() -> None:
    quiet = [heard("", 0, "left", 0.0, "c")]
    said = [heard(word, 0, word, 0.9, word) for word in ("go", "forward", "left", "right", "stop")]
    words = [*said, heard("no", 0, "other", 1.0, "b")]
    sweep = Sweep({"words": words, "reading": quiet, "television": quiet, "noise": quiet}, Rules())
    rules = sweep.rules({0}, Rules())
    for word, start in zip(STARTS, rules.starts):
        assert start >= min(rules.directions[DIRECTIONS.index(word)] + SURER, SUREST) - 1e-9


def test_a_stop_in_talk_is_held_to_no_less_than_without() -> None:
    quiet = [heard("", 0, "left", 0.0, "c")]
    said = [heard(word, 0, word, 0.97, word) for word in ("go", "forward", "left", "right", "stop")]
    words = [*said, heard("no", 0, "other", 1.0, "b")]
    found = Sweep({"words": words, "reading": quiet, "television": quiet, "noise": quiet}, Rules()).rules({0}, Rules())
    assert found.talk_stop == found.stop == 0.95


def test_the_shipped_manifest_has_the_rules_that_are_defined_here() -> None:
    shipped = tomllib.loads((CONFIG / "cues.toml").read_text())["rules"]
    chosen = Rules(
        stop=shipped["stop"]["threshold"],
        directions=tuple(shipped["direction"]["threshold"][word] for word in DIRECTIONS),
        starts=tuple(shipped["start"][word] for word in STARTS),
    )
    written = "\n".join(f"{key} = {toml(value)}" for key, value in rules_table(chosen).items())
    assert tomllib.loads(written) == shipped and f"\n{written}\n" in (CONFIG / "cues.toml").read_text()
