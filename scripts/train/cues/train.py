"""Trains the head, chooses the thresholds on what is kept back from other heads, and reports on that.

Four heads, each blind to one fold of the real recordings and to the one speaker, judge what they have not heard. The
thresholds are chosen on folds 1 to 3; fold 0 is the test. The head that is shipped is made by the same recipe of all
folds and the one speaker: of real voices there is none left to judge it by, the scores are those of the four.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import pickle
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, Callable

import numpy as np

import enrol
import evaluate
import export
import features
import golden
import learning
import sounds
from evaluate import Judged, count, judge, poisson, streams, total
from network import Weights
from rules import DIRECTIONS, Rules
from sounds import ENROLMENT, FOLDS, SPEAKER_FOLD, TEST_FOLD, VALIDATION
from synthesise import BUILD
from windows import group
from words import CUES, LABELS

ROOT = Path(__file__).parents[3]
CONFIG = ROOT / "config/cues"
RUNS = BUILD / "runs"

VALIDATION_CONDITIONS = ("clean", "noise 20 dB", "reverb 0.5 s")


PUPIL_SEED = 100

Heads = dict[int, Weights]  # by the fold that each is blind to


def kept(name: str, key: list[Any], make: Callable[[], Weights]) -> Weights:
    """A head in build/runs, as long as its data, recipe and the rest of its key are the same."""
    stamp = sorted((path.name, path.stat().st_mtime_ns) for path in (BUILD / "windows").glob("*.npz"))
    whole = json.dumps([*key, learning.SHARES, stamp])
    path = RUNS / f"{name}.pickle"
    if path.exists():
        stored_key, weights = pickle.loads(path.read_bytes())
        if stored_key == whole:
            return weights
    weights = make()
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(pickle.dumps((whole, weights)))
    return weights


def fitted(kept_back: list[int], seed: int, recipe: learning.Recipe) -> Weights:
    name = f"head without {kept_back} seed {seed}"
    key = [kept_back, seed, dataclasses.asdict(recipe)]
    return kept(name, key, lambda: learning.fit(learning.pool(set(kept_back)), seed, recipe, name))


def taught(kept_back: list[int], teachers: int, recipe: learning.Recipe) -> Weights:
    """A head that learns what its teachers, fitted before, make of each window on average."""

    def fit() -> Weights:
        data = learning.pool(set(kept_back))
        makes = [learning.judged(fitted(kept_back, seed, recipe), data) for seed in range(teachers)]
        return learning.fit(data, PUPIL_SEED, recipe, name, np.mean(makes, axis=0))

    name = f"head without {kept_back} taught by {teachers}"
    return kept(name, [kept_back, teachers, dataclasses.asdict(recipe)], fit)


def fit_all(recipe: learning.Recipe, teachers: int) -> tuple[Weights, Heads]:
    """The head that is shipped, and those that are blind to a fold and to the one speaker."""
    kept_back = [[fold, SPEAKER_FOLD] for fold in range(FOLDS)] + [[]]
    with ProcessPoolExecutor(2) as processes:
        wanted = [(without, seed, recipe) for seed in range(teachers) for without in kept_back]
        list(processes.map(fitted, *zip(*wanted)))
        *strangers, weights = processes.map(taught, kept_back, [teachers] * len(kept_back), [recipe] * len(kept_back))
    return weights, dict(enumerate(strangers))


def of_fold(name: str, fold: int, condition: str = "clean") -> list[evaluate.Stream]:
    return [s for s in streams(name, condition) if s.fold == fold]


def of_speaker(test: bool, condition: str = "clean") -> list[evaluate.Stream]:
    """The one speaker's clips for validation, or those for tests."""
    first = ENROLMENT + VALIDATION
    return [s for s in streams("one_speaker", condition) if (s.fold >= first if test else ENROLMENT <= s.fold < first)]


# --- Thresholds


def heard_by_strangers(strangers: Heads) -> dict[str, list[Judged]]:
    """What each of the heads has not heard, judged by it: words, the one speaker's words, reading and noise."""
    words, speaker, voices, reading, noise = [], [], [], [], []
    for fold in (fold for fold in strangers if fold != TEST_FOLD):
        weights = strangers[fold]
        for condition in VALIDATION_CONDITIONS:
            words += judge(weights, of_fold("speech_commands", fold, condition))
        speaker += judge(weights, of_speaker(False))
        voices += judge(weights, streams("voices")[::2])
        reading += judge(weights, of_fold("librispeech", fold))
        noise += judge(weights, of_fold("noise", fold))
    return {"words": words, "speaker": speaker, "voices": voices, "reading": reading, "noise": noise}


# Prompts may be passed on only under their own licence, and the one speaker's voice is a private person's.
NOT_REHEARSED = ("prompts", "cues_speaker", "words_speaker")
REHEARSED = 5600

OFF = 1.1  # no probability reaches it


def sweep(judged: dict[str, list[Judged]], cue: str, rules: Rules) -> list[dict[str, float]]:
    """Recall and false accepts of one cue alone by its threshold: from a half, below which all else is as probable."""
    rows = []
    for threshold in np.round(np.arange(0.5, 0.96, 0.05), 2):
        only = [threshold if name == cue else OFF for name in DIRECTIONS]
        tried = dataclasses.replace(
            rules, directions=tuple(only), stop=float(threshold) if cue == "stop" else OFF, forward_after_stop=0.0
        )
        words, speaker, voices = (count(judged[name], tried) for name in ("words", "speaker", "voices"))
        reading, noise = count(judged["reading"], tried), count(judged["noise"], tried)
        accepts = total(words.false_accepts).hits + total(speaker.false_accepts).hits
        accepts += sum(
            len(c)
            for c in (*[words.confusions.get(w, []) for w in CUES], *[speaker.confusions.get(w, []) for w in CUES])
        )
        clips = len(judged["words"]) + len(judged["speaker"])
        rows.append(
            {
                "threshold": float(threshold),
                "words": words.recall[cue].hits / words.recall[cue].n if cue in words.recall else float("nan"),
                "speaker": speaker.recall[cue].hits / speaker.recall[cue].n if cue in speaker.recall else float("nan"),
                "voices": voices.recall[cue].hits / voices.recall[cue].n if cue in voices.recall else float("nan"),
                "accepts": accepts / clips,
                "reading": reading.alarms[cue] / reading.hours,
                "noise": noise.alarms[cue] / noise.hours,
            }
        )
    return rows


def cost(row: dict[str, float], cue: str) -> float:
    """What a threshold costs.

    A miss in ten (of stop: in twenty) as much as three false accepts in a hundred words, twenty false stops an hour of
    reading, four false directions, or three hundred alarms an hour of noise: of that there are few files, each of them
    at three levels, and each is unlike those that the head has heard.
    """
    recalls = [row[name] for name in ("words", "speaker", "voices") if not math.isnan(row[name])]
    alarms = row["reading"] / (20 if cue == "stop" else 4) + row["noise"] / 300
    return (2 if cue == "stop" else 1) * (1 - float(np.mean(recalls))) + 3.3 * row["accepts"] + 0.1 * alarms


def lend_real_voices(rows: dict[str, list[dict[str, float]]]) -> None:
    """Nobody real says *forward*: it is taken to be found as often as *left* and *right* are, by the same threshold.

    By synthetic voices alone any threshold is met, and the strictest would be chosen; real voices are surer of none.
    """
    for row, *others in zip(rows["forward"], rows["left"], rows["right"]):
        for name in ("words", "speaker"):
            row[name] = float(np.mean([other[name] for other in others]))


def choose(judged: dict[str, list[Judged]], rules: Rules) -> Rules:
    picked = {}
    swept = {cue: sweep(judged, cue, rules) for cue in CUES}
    lend_real_voices(swept)
    for cue, rows in swept.items():
        # Where the cost hardly changes, the strictest: noise that nobody has heard yet may sound like a cue, too.
        least = min(cost(row, cue) for row in rows)
        picked[cue] = max(row["threshold"] for row in rows if cost(row, cue) <= least + 0.005)
        print(
            f"\n{cue} on validation: threshold; recall of words, the one speaker, voices; false accepts; "
            "alarms an hour in reading, noise"
        )
        for row in rows:
            mark = "  <" if row["threshold"] == picked[cue] else ""
            print("  " + "  ".join(f"{value:7.3f}" for value in row.values()) + mark)
    directions = tuple(picked[name] for name in DIRECTIONS)
    strict = strictest(swept["forward"], directions[0])
    return dataclasses.replace(rules, stop=picked["stop"], directions=directions, forward_after_stop=strict)


def strictest(rows: list[dict[str, float]], threshold: float) -> float:
    """What *forward* needs after a stop: clearly more, and as much as it takes for nothing else to be taken for it."""
    falsely = ("accepts", "reading", "noise")
    clean = [row["threshold"] for row in rows if all(row[name] == 0 for name in falsely)]
    above = [found for found in clean if found >= threshold + 0.1]
    # Above 0.9 every third "forward" of the held-out voices would have to be said again.
    return min([*above, 0.9])


# --- The table


def listed(cues: list[str]) -> str:
    return ", ".join(cue if n == 1 else f"{n} {cue}" for cue, n in sorted(Counter(cues).items()))


def line(title: str, counts: evaluate.Counts) -> list[str]:
    made = [f"{title}"]
    for cue, rate in counts.recall.items():
        wrong = counts.confusions.get(cue, [])
        made.append(f"  {cue:9} {rate}" + (f"   wrong: {listed(wrong)}" if wrong else ""))
    if counts.false_accepts:
        made.append(f"  other words taken for cues {total(counts.false_accepts)}")
        found = [
            f"{word} {rate.hits:g}/{rate.n:g} ({listed(counts.confusions[word])})"
            for word, rate in counts.false_accepts.items()
            if rate.hits
        ]
        if found:
            made.append("    " + "; ".join(found))
    if counts.latencies_s:
        p50, p95 = np.quantile(counts.latencies_s, [0.5, 0.95])
        made.append(f"  decision after the word's end: p50 {p50:.2f} s, p95 {p95:.2f} s, n {len(counts.latencies_s)}")
    return made


def alarms_line(title: str, counts: evaluate.Counts) -> list[str]:
    directions = sum(counts.alarms[cue] for cue in DIRECTIONS)
    made = [f"{title}: {counts.hours * 60:.1f} minutes"]
    for name, number in (("directions", directions), ("stop", counts.alarms["stop"])):
        low, high = poisson(number, counts.hours)
        made.append(f"  {name:10} {number:g} = {number / counts.hours:.1f} an hour ({low:.1f}-{high:.1f})")
    return made


def crossed(strangers: Heads, name: str, condition: str = "clean") -> list[Judged]:
    """Each recording of a set judged by the head that has not heard its fold."""
    return [j for fold, head in strangers.items() for j in judge(head, of_fold(name, fold, condition))]


def by_each(
    strangers: Heads, heard: list[evaluate.Stream], rules: Rules, stopped: bool = False
) -> evaluate.Counts:
    """What no head has heard, judged by all: the mean of their counts."""
    return evaluate.mean([count(judge(head, heard), rules, stopped) for head in strangers.values()])


def real_forward(strangers: Heads, rules: Rules) -> list[str]:
    made = [judge(head, streams("forward")) for head in strangers.values()]
    if not any(made):
        return []
    loose = dataclasses.replace(rules, isolated=False)
    highest = ", ".join(f"{max(float(j.probabilities[:, 0].max()) for j in said):.2f}" for said in made)
    found = sum(count(said, loose).alarms["forward"] > 0 for said in made)
    return [
        f'the one real forward, in "go forward ten meters": {highest}; without isolation '
        f"{found} of {len(made)} heads find it"
    ]


def by_condition(strangers: Heads, rules: Rules) -> list[str]:
    made = [
        "recall by condition: Speech Commands (each clip by a stranger); one speaker and held-out voices (mean of the "
        "four heads); other words of the first two taken for cues"
    ]
    for condition in evaluate.conditions():
        words = count(crossed(strangers, "speech_commands", condition), rules)
        own = by_each(strangers, of_speaker(True, condition), rules)
        synthetic = by_each(strangers, streams("voices", condition)[1::2], rules)
        wrong = total({**words.false_accepts, **{f"own {w}": r for w, r in own.false_accepts.items()}})
        shown = (
            " ".join(f"{cue} {rate.hits:g}/{rate.n:g}" for cue, rate in counts.recall.items())
            for counts in (words, own, synthetic)
        )
        made.append(f"  {condition:13} {' | '.join(shown)} | {wrong}")
    return made


def table(weights: Weights, strangers: Heads, rules: Rules) -> tuple[list[str], dict[str, Any]]:
    """Lines to print, and the scores that the manifest names."""
    words = count(crossed(strangers, "speech_commands"), rules)
    test = count(judge(strangers[TEST_FOLD], of_fold("speech_commands", TEST_FOLD)), rules)
    speaker = by_each(strangers, of_speaker(True), rules)
    voices = by_each(strangers, streams("voices")[1::2], rules)
    forwards = [s for s in streams("voices")[1::2] if s.word == "forward"]
    starting = by_each(strangers, forwards, rules, stopped=True)
    reading = count(crossed(strangers, "librispeech"), rules)
    test_reading = count(judge(strangers[TEST_FOLD], of_fold("librispeech", TEST_FOLD)), rules)
    test_noise = [s for s in of_fold("noise", TEST_FOLD) if not is_formula(s)]
    noise = count(judge(strangers[TEST_FOLD], test_noise), rules)
    formula = by_each(strangers, list(filter(is_formula, streams("noise"))), rules)
    lines = [
        "Cross-validated scores of the recipe, by four heads. The shipped head is one more: it has heard all of the "
        "real recordings.",
        *line("Speech Commands, test fold", test),
        *line("Speech Commands, all, each clip by the head that has not heard its speaker", words),
        *line("one speaker, test part, not enrolled, mean of the four heads", speaker),
        *line("held-out synthetic voices, mean of the four heads", voices),
        *line("the same after a stop, where forward has to be surer", starting),
        *alarms_line("LibriSpeech, test fold", test_reading),
        *alarms_line("LibriSpeech, all, each file by the head that has not heard it", reading),
        *alarms_line("noise, test fold", noise),
        *alarms_line("noise by formula, mean of the four heads", formula),
        *real_forward(strangers, rules),
        *by_condition(strangers, rules),
        *line("shipped head: held-out synthetic voices", count(judge(weights, streams("voices")[1::2]), rules)),
        *alarms_line(
            "shipped head: noise by formula", count(judge(weights, filter(is_formula, streams("noise"))), rules)
        ),
    ]
    recall = lambda counts: {cue: str(rate) for cue, rate in counts.recall.items()}
    return lines, {
        "speech_commands_test": recall(test),
        "speech_commands_crossed": recall(words),
        "other_words_crossed": str(total(words.false_accepts)),
        "one_speaker": recall(speaker),
        "other_words_one_speaker": str(total(speaker.false_accepts)),
        "voices": recall(voices),
        "voices_after_stop": recall(starting),
        "librispeech_hours": round(reading.hours, 3),
        "librispeech_alarms": reading.alarms,
        "noise_hours": round(noise.hours, 3),
        "noise_alarms": noise.alarms,
        "formula_hours": round(formula.hours, 3),
        "formula_alarms": formula.alarms,
    }


def is_formula(stream: evaluate.Stream) -> bool:
    return "formula" in stream.name


def rehearsal_of(weights: Weights, kept_back: set[int]) -> enrol.Rehearsal:
    shares = {name: share for name, share in learning.SHARES.items() if name not in NOT_REHEARSED}
    return enrol.drawn(weights, learning.pool(kept_back, shares), REHEARSED, np.random.default_rng(0))


def enrolled_head(fold: int, weights: Weights) -> tuple[Weights, float]:
    """With five clips a cue of the one speaker; and what that took, in seconds of CPU."""
    clips = [(LABELS.index(r.word), r.audio) for r in sounds.one_speaker() if r.word in CUES and r.fold < ENROLMENT]
    rehearsal = rehearsal_of(weights, {fold, SPEAKER_FOLD})
    recipe, rng = enrol.Recipe(), np.random.default_rng(0)
    began = time.process_time()
    user = enrol.user_windows(features.Embedding(), weights, clips, recipe, rng)
    return enrol.enrol(weights, user, rehearsal, recipe, rng), time.process_time() - began


def enrolled_table(strangers: Heads, rules: Rules) -> tuple[list[str], dict[str, Any]]:
    """What five clips a cue of the one speaker bring, on those that come later; and what they cost others."""
    made = {fold: enrolled_head(fold, head) for fold, head in strangers.items()}
    heads = {fold: head for fold, (head, _) in made.items()}
    seconds = float(np.mean([s for _, s in made.values()]))
    speaker = by_each(heads, of_speaker(True), rules)
    words = count(crossed(heads, "speech_commands"), rules)
    title = f"one speaker, test part, enrolled with {ENROLMENT} clips a cue in {seconds:.0f} s of CPU, mean of heads"
    lines = [
        *line(title, speaker),
        *line("  others by the enrolled heads: Speech Commands, each clip by a stranger", words),
        *alarms_line("  LibriSpeech, each file by a stranger", count(crossed(heads, "librispeech"), rules)),
        *alarms_line("  noise by formula", by_each(heads, list(filter(is_formula, streams("noise"))), rules)),
    ]
    return lines, {
        "one_speaker_enrolled": {cue: str(rate) for cue, rate in speaker.recall.items()},
        "other_words_one_speaker_enrolled": str(total(speaker.false_accepts)),
    }


def write(
    weights: Weights, rules: Rules, recipe: learning.Recipe, teachers: int, scores: dict[str, Any], lines: list[str]
) -> None:
    """config/cues: the head, its manifest and the table."""
    (CONFIG / "scores.txt").write_text("\n".join([*lines, "", f"{rules}"]) + "\n")
    head = CONFIG / "cues.onnx"
    head.write_bytes(export.model(weights).SerializeToString())
    windows = {name: len(g.labels) for name in learning.SHARES if (g := group(name)) is not None}
    lines = [
        "# Written by scripts/train/cues/train. The rules: scripts/train/cues/rules.py; the model card: README.md.",
        f'sha256 = "{export.sha256(head)}"  # of cues.onnx',
        f'embedding_sha256 = "{export.sha256(features.EMBEDDING_PATH)}"  # of embedding.onnx: scripts/cue-embedding',
        f'rehearsal_sha256 = "{export.sha256(CONFIG / "rehearsal.bin")}"  # of rehearsal.bin, which enrolment needs',
        'features = "speech-embedding-96/1"',
        f"labels = {export.toml(list(LABELS))}",
        f"windows = {features.WINDOWS}",
        "",
        "[rules]",
        *(f"{key} = {export.toml(value)}" for key, value in export.rules_table(rules).items()),
        "",
        "[trained]",
        f"teachers = {teachers}\nsteps = {recipe.steps}\nbatch = {recipe.batch}",
        f"sequences = {export.toml(windows)}",
        "",
        "# Cross-validated scores of the recipe, by four more heads: this one has heard all of the real recordings.",
        "# Hits of clips, the rate and its 95 % interval (Wilson); alarms are counts; of several heads the mean.",
        "[trained.scores]",
        *(f"{key} = {export.toml(value)}" for key, value in scores.items()),
    ]
    (CONFIG / "cues.toml").write_text("\n".join(lines) + "\n")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=learning.Recipe.steps)
    parser.add_argument("--teachers", type=int, default=5, help="of each head, a seed each")
    parser.add_argument("--try", dest="trial", action="store_true", help="write nothing to config/cues")
    arguments = parser.parse_args()
    began = time.monotonic()
    recipe = learning.Recipe(steps=arguments.steps)
    weights, strangers = fit_all(recipe, arguments.teachers)
    rules = choose(heard_by_strangers(strangers), Rules())
    lines, scores = table(weights, strangers, rules)
    more, enrolled_scores = enrolled_table(strangers, rules)
    print()
    print("\n".join(lines + more))
    print(f"\n{rules}\n{time.monotonic() - began:.0f} s")
    (RUNS / "last.pickle").write_bytes(pickle.dumps((weights, strangers, rules, scores)))
    if not arguments.trial:
        enrol.write_rehearsal(CONFIG / "rehearsal.bin", rehearsal_of(weights, set()))
        write(weights, rules, recipe, arguments.teachers, scores | enrolled_scores, lines + more)
        golden.PATH.parent.mkdir(parents=True, exist_ok=True)
        golden.PATH.write_text(golden.text(CONFIG / "cues.onnx"))


if __name__ == "__main__":
    main()
