"""Trains the head, chooses the thresholds on the validation parts, and reports on the test parts.

Three heads, each blind to the test fold and to one more, judge what they have not heard: thresholds are chosen on that.
The head that is shipped has heard all but the test fold.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import pickle
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

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
from sounds import ENROLMENT, FOLDS, TEST_FOLD, VALIDATION
from synthesise import BUILD
from windows import group
from words import CUES, LABELS

ROOT = Path(__file__).parents[3]
CONFIG = ROOT / "config/cues"
RUNS = BUILD / "runs"

VALIDATION_CONDITIONS = ("clean", "noise 20 dB", "reverb 0.5 s")


def fitted(kept_back: set[int], seed: int, recipe: learning.Recipe) -> Weights:
    """A head, kept in build/runs as long as its data and recipe are the same."""
    stamp = sorted((path.name, path.stat().st_mtime_ns) for path in (BUILD / "windows").glob("*.npz"))
    key = json.dumps([sorted(kept_back), seed, dataclasses.asdict(recipe), learning.SHARES, stamp])
    path = RUNS / f"head without {sorted(kept_back)} seed {seed}.pickle"
    if path.exists():
        stored_key, weights = pickle.loads(path.read_bytes())
        if stored_key == key:
            return weights
    progress = f"head without fold {' and '.join(map(str, sorted(kept_back)))}, seed {seed}"
    weights = learning.fit(learning.pool(kept_back), seed, recipe, progress)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(pickle.dumps((key, weights)))
    return weights


def of_fold(name: str, fold: int, condition: str = "clean") -> list[evaluate.Stream]:
    return [s for s in streams(name, condition) if s.fold == fold]


def of_speaker(test: bool, condition: str = "clean") -> list[evaluate.Stream]:
    """The one speaker's clips for validation, or those for tests."""
    first = ENROLMENT + VALIDATION
    return [s for s in streams("one_speaker", condition) if (s.fold >= first if test else ENROLMENT <= s.fold < first)]


# --- Thresholds


def heard_by_strangers(heads: dict[int, Weights]) -> dict[str, list[Judged]]:
    """What each of the heads has not heard, judged by it: words, the one speaker's words, reading and noise."""
    words, speaker, voices, reading, noise = [], [], [], [], []
    for fold, weights in heads.items():
        for condition in VALIDATION_CONDITIONS:
            words += judge(weights, of_fold("speech_commands", fold, condition))
        speaker += judge(weights, of_speaker(False))
        voices += judge(weights, streams("voices")[::2])
        reading += judge(weights, of_fold("librispeech", fold))
        noise += judge(weights, of_fold("noise", fold))
    return {"words": words, "speaker": speaker, "voices": voices, "reading": reading, "noise": noise}


# Prompts may be passed on only under their own licence, and the one speaker's voice is a private person's.
NOT_REHEARSED = ("prompts", "words_speaker")
REHEARSED = 5600

OFF = 1.1  # no probability reaches it


def sweep(judged: dict[str, list[Judged]], cue: str, rules: Rules) -> list[dict[str, float]]:
    """Recall and false accepts of one cue alone by its threshold."""
    rows = []
    for threshold in np.round(np.arange(0.3, 0.96, 0.05), 2):
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

    A miss in ten (of stop: in twenty) as much as two false accepts in a hundred words, twenty false stops an hour of
    reading, four false directions, or a hundred alarms an hour of noise: of that there are few files, and each is
    unlike those that the head has heard.
    """
    recalls = [row[name] for name in ("words", "speaker", "voices") if not math.isnan(row[name])]
    alarms = row["reading"] / (20 if cue == "stop" else 4) + row["noise"] / 100
    return (2 if cue == "stop" else 1) * (1 - float(np.mean(recalls))) + 5 * row["accepts"] + 0.1 * alarms


def choose(judged: dict[str, list[Judged]], rules: Rules) -> Rules:
    picked = {}
    for cue in CUES:
        rows = sweep(judged, cue, rules)
        # Where the cost hardly changes, the strictest: noise that nobody has heard yet may sound like a cue, too.
        least = min(cost(row, cue) for row in rows)
        picked[cue] = max(row["threshold"] for row in rows if cost(row, cue) <= least + 0.02)
        print(
            f"\n{cue} on validation: threshold; recall of words, the one speaker, voices; false accepts; "
            "alarms an hour in reading, noise"
        )
        for row in rows:
            mark = "  <" if row["threshold"] == picked[cue] else ""
            print("  " + "  ".join(f"{value:7.3f}" for value in row.values()) + mark)
    directions = tuple(picked[name] for name in DIRECTIONS)
    # Above 0.9 every third "forward" of the held-out voices would have to be said again.
    strict = min(0.9, max(0.85, directions[0] + 0.1))
    return dataclasses.replace(rules, stop=picked["stop"], directions=directions, forward_after_stop=strict)


# --- The table


def line(title: str, counts: evaluate.Counts) -> list[str]:
    made = [f"{title}"]
    for cue, rate in counts.recall.items():
        wrong = counts.confusions.get(cue, [])
        made.append(f"  {cue:9} {rate}" + (f"   wrong: {', '.join(wrong)}" if wrong else ""))
    if counts.false_accepts:
        made.append(f"  other words taken for cues {total(counts.false_accepts)}")
        found = [
            f"{w} {r.hits}/{r.n} ({', '.join(counts.confusions[w])})" for w, r in counts.false_accepts.items() if r.hits
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
        made.append(f"  {name:10} {number} = {number / counts.hours:.1f} an hour ({low:.1f}-{high:.1f})")
    return made


def table(weights: Weights, strangers: dict[int, Weights], rules: Rules) -> tuple[list[str], dict[str, Any]]:
    """Lines to print, and the scores that the manifest names."""

    def all_words(condition: str) -> list[Judged]:
        """Each real word judged by a head that has not heard its speaker."""
        heads = {TEST_FOLD: weights, **strangers}
        return [j for fold, head in heads.items() for j in judge(head, of_fold("speech_commands", fold, condition))]

    lines: list[str] = []
    test = count(judge(weights, of_fold("speech_commands", TEST_FOLD)), rules)
    crossed = count(all_words("clean"), rules)
    speaker = count(judge(weights, of_speaker(True)), rules)
    voices = count(judge(weights, streams("voices")[1::2]), rules)
    reading = count(judge(weights, of_fold("librispeech", TEST_FOLD)), rules)
    strange = [
        j for fold, head in {TEST_FOLD: weights, **strangers}.items() for j in judge(head, of_fold("librispeech", fold))
    ]
    reading_crossed = count(strange, rules)
    noise = count(judge(weights, of_fold("noise", TEST_FOLD)), rules)
    lines += line("Speech Commands, test fold", test)
    lines += line("Speech Commands, all, each clip by a head that has not heard its speaker", crossed)
    lines += line("one speaker, test part, not enrolled", speaker)
    lines += line("held-out synthetic voices", voices)
    lines += alarms_line("LibriSpeech, test fold", reading)
    lines += alarms_line("LibriSpeech, all, each file by a head that has not heard it", reading_crossed)
    lines += alarms_line("noise, test fold and by formula", noise)
    said = judge(weights, streams("forward"))
    if said:
        loose = dataclasses.replace(rules, isolated=False)
        found = ", ".join(cue for cue, n in count(said, loose).alarms.items() if n)
        highest = max(float(j.probabilities[:, 0].max()) for j in said)
        lines.append(
            f'the one real forward, in "go forward ten meters": {highest:.2f}; without isolation: {found or "nothing"}'
        )
    lines.append(
        "recall by condition: Speech Commands (as above), one speaker, held-out voices; other words taken for cues"
    )
    by_condition: dict[str, Any] = {}
    for condition in evaluate.conditions():
        words = count(all_words(condition), rules)
        own = count(judge(weights, of_speaker(True, condition)), rules)
        synthetic = count(judge(weights, streams("voices", condition)[1::2]), rules)
        show = lambda counts: " ".join(f"{c} {r.hits}/{r.n}" for c, r in counts.recall.items())
        wrong = total({**words.false_accepts, **{f"own {w}": r for w, r in own.false_accepts.items()}})
        lines.append(f"  {condition:13} {show(words)} | {show(own)} | {show(synthetic)} | {wrong}")
        by_condition[condition] = {
            "words": str(total(words.recall)),
            "speaker": str(total(own.recall)),
            "voices": str(total(synthetic.recall)),
        }
    scores = {
        "speech_commands_test": {cue: str(rate) for cue, rate in test.recall.items()},
        "speech_commands_crossed": {cue: str(rate) for cue, rate in crossed.recall.items()},
        "other_words_crossed": str(total(crossed.false_accepts)),
        "one_speaker": {cue: str(rate) for cue, rate in speaker.recall.items()},
        "other_words_one_speaker": str(total(speaker.false_accepts)),
        "voices": {cue: str(rate) for cue, rate in voices.recall.items()},
        "librispeech_hours": round(reading_crossed.hours, 3),
        "librispeech_alarms": reading_crossed.alarms,
        "noise_hours": round(noise.hours, 3),
        "noise_alarms": noise.alarms,
    }
    return lines, scores


def enrolled_table(weights: Weights, rehearsal: enrol.Rehearsal, rules: Rules) -> tuple[list[str], dict[str, Any]]:
    """What five clips a cue of the one speaker bring, on those that come later; and what they cost others."""
    clips = [(LABELS.index(r.word), r.audio) for r in sounds.one_speaker() if r.word in CUES and r.fold < ENROLMENT]
    recipe, rng = enrol.Recipe(), np.random.default_rng(0)
    began = time.process_time()
    user = enrol.user_windows(features.Embedding(), weights, clips, recipe, rng)
    enrolled = enrol.enrol(weights, user, rehearsal, recipe, rng)
    seconds = time.process_time() - began
    speaker = count(judge(enrolled, of_speaker(True)), rules)
    lines = line(f"one speaker, test part, enrolled with {ENROLMENT} clips a cue in {seconds:.0f} s of CPU", speaker)
    lines += line(
        "  others by the enrolled head: Speech Commands, test fold",
        count(judge(enrolled, of_fold("speech_commands", TEST_FOLD)), rules),
    )
    lines += alarms_line("  LibriSpeech, test fold", count(judge(enrolled, of_fold("librispeech", TEST_FOLD)), rules))
    lines += alarms_line(
        "  noise, test fold and by formula", count(judge(enrolled, of_fold("noise", TEST_FOLD)), rules)
    )
    return lines, {
        "one_speaker_enrolled": {cue: str(rate) for cue, rate in speaker.recall.items()},
        "other_words_one_speaker_enrolled": str(total(speaker.false_accepts)),
    }


def write(
    weights: Weights, rules: Rules, recipe: learning.Recipe, seed: int, scores: dict[str, Any], lines: list[str]
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
        f"seed = {seed}\nsteps = {recipe.steps}\nbatch = {recipe.batch}",
        f"sequences = {export.toml(windows)}",
        "",
        "# Hits of clips, the rate and its 95 % interval (Wilson); alarms are counts.",
        "[trained.scores]",
        *(f"{key} = {export.toml(value)}" for key, value in scores.items()),
    ]
    (CONFIG / "cues.toml").write_text("\n".join(lines) + "\n")


def worth(weights: Weights, rules: Rules) -> float:
    """What seeds are compared by: recall less five times the false accepts, where no seed has trained."""
    heard = []
    for condition in ("clean", "noise 10 dB"):
        heard.append(count(judge(weights, of_speaker(False, condition)), rules))
        heard.append(count(judge(weights, streams("voices", condition)[::2]), rules))
    rate = lambda r: r.hits / max(r.n, 1)
    return float(np.mean([rate(total(c.recall)) - 5 * rate(total(c.false_accepts)) for c in heard]))


def line_of_seed(seed: int, weights: Weights, rules: Rules) -> str:
    speaker, voices = (count(judge(weights, s), rules) for s in (of_speaker(True), streams("voices")[1::2]))
    words, reading = (
        count(judge(weights, of_fold(name, TEST_FOLD)), rules) for name in ("speech_commands", "librispeech")
    )
    recalls = ", ".join(f"{cue} {rate.hits}/{rate.n}" for cue, rate in speaker.recall.items())
    accepts = total({**speaker.false_accepts, **{f"words {w}": r for w, r in words.false_accepts.items()}})
    alarms = f"{sum(reading.alarms.values())} alarms in {reading.hours * 60:.1f} minutes of reading"
    return f"  seed {seed}: one speaker {recalls}; voices {total(voices.recall)}; false accepts {accepts}; {alarms}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=learning.Recipe.steps)
    parser.add_argument(
        "--seeds", type=int, default=3, help="heads of as many seeds; the best on validation is shipped"
    )
    parser.add_argument("--try", dest="trial", action="store_true", help="write nothing to config/cues")
    arguments = parser.parse_args()
    began = time.monotonic()
    recipe = learning.Recipe(steps=arguments.steps)
    folds, seeds = [fold for fold in range(FOLDS) if fold != TEST_FOLD], range(arguments.seeds)
    with ProcessPoolExecutor(2) as processes:
        wanted = [({TEST_FOLD, fold}, fold) for fold in folds] + [({TEST_FOLD}, seed) for seed in seeds]
        heads = list(processes.map(fitted, *zip(*wanted), [recipe] * len(wanted)))
    strangers, candidates = dict(zip(folds, heads)), heads[len(folds) :]
    rules = choose(heard_by_strangers(strangers), Rules())
    seed = max(seeds, key=lambda seed: worth(candidates[seed], rules))
    weights = candidates[seed]
    lines, scores = table(weights, strangers, rules)
    lines += [f"seed {seed} of {len(seeds)}, by the validation part of the one speaker and half the held-out voices"]
    lines += [line_of_seed(n, candidate, rules) for n, candidate in enumerate(candidates)]
    rehearsal = CONFIG / "rehearsal.bin" if not arguments.trial else RUNS / "rehearsal.bin"
    data = learning.pool(
        {TEST_FOLD}, {name: share for name, share in learning.SHARES.items() if name not in NOT_REHEARSED}
    )
    enrol.write_rehearsal(rehearsal, enrol.drawn(weights, data, REHEARSED, np.random.default_rng(0)))
    more, enrolled_scores = enrolled_table(weights, enrol.read_rehearsal(rehearsal), rules)
    print()
    print("\n".join(lines + more))
    print(f"\n{rules}\n{time.monotonic() - began:.0f} s")
    (RUNS / "last.pickle").write_bytes(pickle.dumps((weights, strangers, rules, scores)))
    if not arguments.trial:
        write(weights, rules, recipe, seed, scores | enrolled_scores, lines + more)
        golden.PATH.parent.mkdir(parents=True, exist_ok=True)
        golden.PATH.write_text(golden.text(CONFIG / "cues.onnx"))


if __name__ == "__main__":
    main()
