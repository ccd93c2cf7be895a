"""Chooses thresholds, prints what the recogniser is worth, and writes config/cues.

Every figure is of recordings that neither the network nor its thresholds have seen: thresholds for a fold are chosen
on the other folds, each judged by the network that has not heard it. What is shipped is the network without fold 0,
with the thresholds of folds 1 to 4: the speakers of fold 0 test it.
"""

from __future__ import annotations

import argparse
import dataclasses
import pickle
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import evaluate
import export
import golden
import network
import rehearsal
import strangers
import trunk
from evaluate import Counts, Heard, count, poisson, total
from rules import DIRECTIONS, STARTS, Rules, detect
from synthesise import BUILD
from words import CUES, LABELS

ROOT = Path(__file__).parents[3]
CONFIG = ROOT / "config/cues"
FOLDS_PATH = Path(__file__).parent / "folds"
SHIPPED = 0
FEATURES = "speech-embedding-96/2"

OFF = 1.1  # no probability reaches it
GRID = tuple(float(t) for t in np.round(np.arange(0.3, 0.96, 0.05), 2))
# The share of a word's clips that has to be found: the threshold is the strictest by which it is. Of *forward* there are
# six clips: it takes the mean of the other directions' thresholds.
WANTED = {"stop": 0.96, "left": 0.94, "right": 0.94, "go": 0.88}
# After a stop a word has to be surer by the first, and as sure as hardly any other is; but not surer than the second.
SURER, SUREST, STARTED_BY_OTHERS = 0.1, 0.85, 0.001


# --- Thresholds


SWEPT = ("words", "reading", "television", "noise")


class Sweep:
    """What each cue alone would make of every recording, at each threshold: how often it is detected."""

    def __init__(self, heard: dict[str, list[Heard]], rules: Rules) -> None:
        self.heard = {name: heard[name] for name in SWEPT}
        with ProcessPoolExecutor(2) as processes:
            of_cues = processes.map(partial(found_of, self.heard, rules), CUES)
            self.found = {(cue, name): found[name] for cue, found in zip(CUES, of_cues) for name in SWEPT}

    def share(self, cue: str, folds: set[int], is_own: bool) -> np.ndarray:
        """Of clips of the word itself, or of those that mean something else, by threshold."""
        same = {cue, evaluate.meant(cue)} | ({"go"} if cue == "forward" else set())
        wanted = [
            h.fold in folds and (h.word == cue if is_own else h.word not in same) for h in self.heard["words"]
        ]
        return (self.found[cue, "words"][wanted] > 0).mean(axis=0)

    def an_hour(self, cue: str, name: str, folds: set[int]) -> np.ndarray:
        wanted = [h.fold in folds for h in self.heard[name]]
        hours = sum(h.hours for h in self.heard[name] if h.fold in folds)
        return self.found[cue, name][wanted].sum(axis=0) / max(hours, 1e-9)

    def strictest(self, cue: str, folds: set[int]) -> float:
        """The strictest threshold that finds as much as is wanted."""
        found = self.share(cue, folds, True) >= WANTED[cue]
        return max((t for t, fit in zip(GRID, found) if fit), default=GRID[0])

    def start(self, cue: str, folds: set[int], least: float) -> float:
        nothing = self.share(cue, folds, False) <= STARTED_BY_OTHERS
        for name in ("reading", "television", "noise"):
            nothing &= self.an_hour(cue, name, folds) == 0
        clean = [t for t, fit in zip(GRID, np.logical_and.accumulate(nothing[::-1])[::-1]) if fit]
        return min([t for t in clean if t >= least + SURER - 1e-9] + [SUREST])

    def rules(self, folds: set[int], rules: Rules) -> Rules:
        stop, left, right, go = (self.strictest(cue, folds) for cue in ("stop", "left", "right", "go"))
        forward = GRID[int(np.argmin(np.abs(np.array(GRID) - (left + right) / 2)))]
        starts = (self.start("forward", folds, forward), self.start("go", folds, go))
        found = dataclasses.replace(rules, stop=stop, directions=(forward, left, right, go), starts=starts)
        return dataclasses.replace(found, talk_stop=max(stop, found.talk_stop))  # In talk no laxer than without.


def found_of(heard: dict[str, list[Heard]], rules: Rules, cue: str) -> dict[str, np.ndarray]:
    return {name: np.array([found_at(cue, one, rules) for one in ones]) for name, ones in heard.items()}


def found_at(cue: str, heard: Heard, rules: Rules) -> list[int]:
    """Detections by threshold."""
    most = float(heard.probabilities[:, LABELS.index(cue)].max(initial=0))
    made = []
    for threshold in GRID:
        if most < threshold:
            made.append(0)
            continue
        only = tuple(threshold if name == cue else OFF for name in DIRECTIONS)
        tried = dataclasses.replace(rules, directions=only, stop=threshold if cue == "stop" else OFF, starts=(0.0, 0.0))
        # Without the rule of talk: with it, no stream here would show how sure a word has to be that starts the robot.
        tried = dataclasses.replace(tried, talk_s=rules.reach_s)
        made.append(len(detect(tried, heard.probabilities, heard.levels, heard.periodicities)))
    return made


def sweep_lines(sweep: Sweep, folds: set[int]) -> list[str]:
    made = ["threshold: recall, other words taken for it, alarms an hour of reading, of television, of noise"]
    for cue in CUES:
        made.append(cue)
        rows = [sweep.share(cue, folds, own) for own in (True, False)]
        rows += [sweep.an_hour(cue, name, folds) for name in ("reading", "television", "noise")]
        made += [f"  {t:.2f}: " + "  ".join(f"{row[i]:.4f}" for row in rows) for i, t in enumerate(GRID)]
    return made


# --- The table


def lines_of(title: str, counts: Counts) -> list[str]:
    made = [title] + [f"  {cue:9} {rate}" for cue, rate in counts.recall.items()]
    if counts.false_accepts:
        made.append(f"  other words taken for cues {total(counts.false_accepts)}")
        often = sorted(counts.false_accepts.items(), key=lambda item: -item[1].hits / item[1].n)
        shown = [f"{word} {rate.hits:.4g}/{rate.n:g} ({listed(counts, word)})" for word, rate in often if rate.hits]
        made += [f"    {'; '.join(shown)}"] if shown else []
    wrong = [f"{cue} ({listed(counts, cue)})" for cue in counts.recall if counts.taken_for.get(cue)]
    made += [f"  cues taken for others: {'; '.join(wrong)}"] if wrong else []
    if counts.latencies_s:
        p50, p95 = np.quantile(counts.latencies_s, [0.5, 0.95])
        made.append(f"  decision after the word's end: p50 {p50:.2f} s, p95 {p95:.2f} s")
    made.append(f"  decided differently at some of the phases: {counts.unsteady}")
    return made


def listed(counts: Counts, word: str) -> str:
    return ", ".join(f"{cue} {n:.3g}" for cue, n in sorted(counts.taken_for.get(word, {}).items()))


def alarms_of(title: str, counts: Counts) -> list[str]:
    directions = sum(counts.alarms[cue] for cue in ("forward", "left", "right"))
    made = [f"{title}: {counts.hours * 60:.1f} minutes"]
    for name, number in (("directions", directions), ("stop", counts.alarms["stop"])):
        low, high = poisson(number, counts.hours)
        made.append(f"  {name:10} {number:.4g} = {number / counts.hours:.1f} an hour ({low:.1f}-{high:.1f})")
    return made


def table(heard: dict[str, list[Heard]], rules: dict[int, Rules]) -> tuple[list[str], dict[str, Any]]:
    """Lines to print, and the scores that the manifest names."""
    crossed, shipped = lambda fold: rules[fold], lambda fold: rules[SHIPPED]
    of_shipped = lambda name: [h for h in heard[name] if h.fold == SHIPPED]
    words, own = count(heard["words"], crossed), count(of_shipped("words"), shipped)
    said = lambda word: [h for h in heard["words"] if h.word == word]
    standing = {word: count(said(word), crossed, stopped=True).recall[word] for word in STARTS}
    sets = {name: count(heard[name], crossed) for name in heard}
    speakers = len({strangers.speaker_of(Path(h.name)) for h in heard["words"]})
    lines = [
        "Each recording by the network and the thresholds that have not met its speaker; means over four phases.",
        *lines_of(f"{words.recall['stop'].n:g} clips of stop by {speakers} speakers (five networks)", words),
        "  from standing: " + "; ".join(f"{word} {rate}" for word, rate in standing.items()),
        *lines_of("the shipped network and thresholds, on the speakers that it never met", own),
        *lines_of("one speaker whose first language is another", sets["one speaker"]),
        *lines_of("synthetic voices that never trained", sets["voices"]),
        *lines_of("words that sound like cues, by synthetic voices that never trained", sets["alikes"]),
        *alarms_of("reading (LibriSpeech)", sets["reading"]),
        *alarms_of("television (synthetic voices that never trained, music)", sets["television"]),
        *alarms_of("noise, recorded and by formula", sets["noise"]),
    ]
    shown = lambda counts: {cue: str(rate) for cue, rate in counts.recall.items()}
    return lines, {
        "speakers_crossed": shown(words),
        "from_standing_crossed": {word: str(rate) for word, rate in standing.items()},
        "other_words_crossed": str(total(words.false_accepts)),
        "speakers_shipped": shown(own),
        "other_words_shipped": str(total(own.false_accepts)),
        "one_speaker": shown(sets["one speaker"]),
        "other_words_one_speaker": str(total(sets["one speaker"].false_accepts)),
        "alikes": {word: str(rate) for word, rate in sets["alikes"].false_accepts.items()},
        "voices": shown(sets["voices"]),
        **{f"{name}_hours": round(sets[name].hours, 3) for name in ("reading", "television", "noise")},
        **{f"{name}_alarms": sets[name].alarms for name in ("reading", "television", "noise")},
    }


def by_condition(networks: dict[int, evaluate.Network], rules: dict[int, Rules]) -> list[str]:
    made = ["by condition, every recording of the 151 speakers once"]
    for condition in evaluate.conditions():
        counts = count(
            evaluate.played_by_all(networks, "words", condition, phases=(0,)), lambda fold: rules[fold]
        )
        found = " ".join(f"{cue} {rate.hits / rate.n:.3f}" for cue, rate in counts.recall.items())
        made.append(f"  {condition:13} {found} | other words {total(counts.false_accepts)}")
    return made


# --- Files

# Prompts may be passed on only under their own licence.
NOT_REHEARSED = ("prompts",)
REHEARSED = 5600


def rehearsed(path: Path, head: network.Weights) -> rehearsal.Rehearsal:
    """Windows that trained the network: two fifths cues, and what it finds hard more often."""
    import torch

    import tune

    data, ears, dice = tune.Pool("cpu"), tune.load(path), np.random.default_rng(0)
    chances = data.chances({SHIPPED})
    chances[np.isin(data.group, NOT_REHEARSED)] = 0
    # Those that are looked at, of which some are kept.
    at = dice.choice(len(chances), 4 * REHEARSED, p=chances / chances.sum())
    seen, first = tune.embedded(ears, data, at).float(), torch.from_numpy(dice.integers(0, tune.SHIFTS, len(at)))
    windows = seen[torch.arange(len(at))[:, None], first[:, None] + torch.arange(tune.WINDOWS)].numpy()
    flat, labels = network.convolved(head, windows)[3], data.labels.numpy()[at]
    wrong = 1 - network.classified(head, flat)[1][np.arange(len(at)), labels]
    weight = 1 + 4 * wrong
    for is_cue, part in ((True, 0.4), (False, 0.6)):
        of_kind = (labels != LABELS.index("other")) == is_cue
        weight[of_kind] *= part / weight[of_kind].sum()
    kept = np.sort(dice.choice(len(at), REHEARSED, replace=False, p=weight / weight.sum()))
    return rehearsal.Rehearsal(flat[kept], labels[kept].astype(np.int64))


def write(path: Path, rules: Rules, scores: dict[str, Any], lines: list[str]) -> None:
    """config/cues: the networks, their manifest and the table; and what the robot's own code has to compute."""
    layers, head = evaluate.parts(path)
    (CONFIG / "scores.txt").write_text("\n".join([*lines, "", f"{rules}"]) + "\n")
    (CONFIG / "embedding.onnx").write_bytes(trunk.stepwise(layers).SerializeToString())
    (CONFIG / "cues.onnx").write_bytes(export.model(head).SerializeToString())
    rehearsal.write(CONFIG / "rehearsal.bin", rehearsed(path, head))
    digest = lambda name: export.sha256(CONFIG / name)
    manifest = [
        "# Written by scripts/train/cues/ship.py. The rules: scripts/train/cues/rules.py; the model card: README.md.",
        f'sha256 = "{digest("cues.onnx")}"  # of cues.onnx',
        f'embedding_sha256 = "{digest("embedding.onnx")}"  # of embedding.onnx',
        f'rehearsal_sha256 = "{digest("rehearsal.bin")}"  # of rehearsal.bin, which enrolment needs',
        f'features = "{FEATURES}"',
        f"labels = {export.toml(list(LABELS))}",
        f"windows = {evaluate.WINDOWS}",
        "",
        "[rules]",
        *(f"{key} = {export.toml(value)}" for key, value in export.rules_table(rules).items()),
        "",
        "# Means over four phases; each recording judged by a network and thresholds that have not met its speaker.",
        "# Hits of clips, the rate and its 95 % interval (Wilson); alarms are counts.",
        "[trained.scores]",
        *(f"{key} = {export.toml(value)}" for key, value in scores.items()),
    ]
    (CONFIG / "cues.toml").write_text("\n".join(manifest) + "\n")
    golden.PATH.write_text(golden.text(path, CONFIG / "cues.onnx"))


def heard_by(networks: dict[int, evaluate.Network], paths: dict[int, Path]) -> dict[str, list[Heard]]:
    """All sets, kept in build/ as long as the networks are the same: rules may be tried without hearing again."""
    kept, key = BUILD / "heard.pickle", [export.sha256(path) for path in paths.values()]
    if kept.exists():
        stored_key, heard = pickle.loads(kept.read_bytes())
        if stored_key == key:
            return heard
    heard = {name: evaluate.played_by_all(networks, name) for name in evaluate.SETS}
    kept.parent.mkdir(exist_ok=True)
    kept.write_bytes(pickle.dumps((key, heard)))
    return heard


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folds", type=Path, default=FOLDS_PATH)
    parser.add_argument("--try", dest="trial", action="store_true", help="write nothing to config/cues")
    parser.add_argument("--conditions", action="store_true", help="judge noise, rooms and shouts, too")
    arguments = parser.parse_args()
    began = time.monotonic()
    paths = {fold: arguments.folds / f"fold-{fold}.npz" for fold in range(strangers.FOLDS)}
    networks = {fold: evaluate.read(path) for fold, path in paths.items()}
    heard = heard_by(networks, paths)
    sweep, folds = Sweep(heard, Rules()), set(networks)
    rules = {fold: sweep.rules(folds - {fold}, Rules()) for fold in networks}
    lines, scores = table(heard, rules)
    lines += by_condition(networks, rules) if arguments.conditions else []
    print("\n".join([*sweep_lines(sweep, folds), "", *lines]))
    print(f"\n{rules[SHIPPED]}\n{time.monotonic() - began:.0f} s")
    if not arguments.trial:
        write(paths[SHIPPED], rules[SHIPPED], scores, lines)


if __name__ == "__main__":
    main()
