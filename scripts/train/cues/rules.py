"""From probabilities to cues: the rules that the robot follows, pure and without a clock.

Time goes in steps of 80 ms. A step has the head's probabilities and the levels of its eight newest frames of 10 ms.

Level. A frame's level in decibels is the mean over bands 4 to 27 (of 0 to 31) of its log-mel, less 2, times 10.

Floor. The level of what is always there. It begins at the first frame's level. A frame below the floor draws it down
by `floor_fall` of the distance; a frame above raises it by `floor_rise` decibels, but never above the frame.

Quiet. A frame is loud if its level is above floor + `margin` and above `peak` - `depth`, else quiet; `peak` is the
highest level heard since the last `quiet` of quiet, and has itself no part in the first frame of a segment.

Segment. Opens with a loud frame, closes once its frames have been quiet for `quiet`. Its length goes from its first
loud frame to its last.

stop. A step with P(stop) >= threshold, `windows` steps in a row (one). It is reported at once, ends whatever was
waiting, and isn't reported again within `refractory`.

Directions. P(word) >= threshold and above all others, in each of `windows` successive steps: a candidate. It is
reported in the first step, its own included, in which no segment is open. It is dropped if its segment is longer than
`segment_max`, or still open after `wait_max`. Its segment is the open one, else the last one if that ended at most
`reach` before the candidate's step; without either it stands alone. While one waits, further steps of the same word change nothing, and another word's candidate takes its place. After a report no
direction is reported for `refractory`. `forward` after a stop needs `forward_after_stop` until a direction was
reported.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from words import LABELS

STEP_S, FRAME_S = 0.08, 0.01
DIRECTIONS = LABELS[:3]
STOP = LABELS.index("stop")


@dataclass(frozen=True)
class Rules:
    stop: float = 0.7
    stop_windows: int = 1
    directions: tuple[float, float, float] = (0.7, 0.7, 0.7)  # forward, left, right
    direction_windows: int = 2
    forward_after_stop: float = 0.85
    isolated: bool = True
    refractory_s: float = 1.0
    quiet_s: float = 0.18
    segment_max_s: float = 1.15
    wait_max_s: float = 0.6
    reach_s: float = 0.5
    margin_db: float = 8.0
    depth_db: float = 20.0
    floor_rise_db: float = 0.02
    floor_fall: float = 0.2


class Detection(NamedTuple):
    cue: str
    step: int  # in which it is reported
    heard: int  # in which it became a candidate
    score: float  # the lower of the probabilities that made it


@dataclass
class Levels:
    """The floor, and the segment of sound that is open or was the last."""

    rules: Rules
    floor: float | None = None
    peak: float = -np.inf
    frame: int = -1
    first: int = -1
    last: int = -1
    open: bool = False

    def hear(self, level: float) -> None:
        rules = self.rules
        self.frame += 1
        if self.floor is None:
            self.floor = level
        elif level < self.floor:
            self.floor += rules.floor_fall * (level - self.floor)
        else:
            self.floor = min(level, self.floor + rules.floor_rise_db)
        if level > self.floor + rules.margin_db and level > self.peak - rules.depth_db:
            if not self.open:
                self.open, self.first = True, self.frame
            self.last = self.frame
            self.peak = max(self.peak, level)
        elif self.open and self.frame - self.last >= round(rules.quiet_s / FRAME_S):
            self.open, self.peak = False, -np.inf

    @property
    def length_s(self) -> float:
        return (self.last - self.first + 1) * FRAME_S if self.first >= 0 else 0.0

    def too_long(self) -> bool:
        return self.length_s > self.rules.segment_max_s


class Candidate(NamedTuple):
    word: int
    step: int
    score: float


@dataclass
class Recogniser:
    rules: Rules = field(default_factory=Rules)
    stopped: bool = False

    def __post_init__(self) -> None:
        self.levels = Levels(self.rules)
        self.step = -1
        self.streak = [0] * len(LABELS)
        self.lowest = [1.0] * len(LABELS)
        self.waiting: Candidate | None = None
        self.silent_until = {"stop": 0, "direction": 0}

    def hear(self, probabilities: np.ndarray, levels: np.ndarray) -> list[Detection]:
        """What a step of float[5] and the levels float[8] of its frames make known."""
        self.step += 1
        for level in levels:
            self.levels.hear(float(level))
        self.count(probabilities)
        refractory = round(self.rules.refractory_s / STEP_S)
        if self.streak[STOP] >= self.rules.stop_windows:
            self.waiting, self.stopped = None, True
            if self.step < self.silent_until["stop"]:
                return []
            self.silent_until["stop"] = self.step + refractory
            return [Detection("stop", self.step, self.step, self.lowest[STOP])]
        for word in range(len(DIRECTIONS)):
            if self.streak[word] >= self.rules.direction_windows and self.step >= self.silent_until["direction"]:
                if self.waiting is None or self.waiting.word != word:
                    self.waiting = Candidate(word, self.step, self.lowest[word])
        if self.waiting is None or not self.isolated():
            return []
        made, self.waiting, self.stopped = self.waiting, None, False
        self.silent_until["direction"] = self.step + refractory
        return [Detection(LABELS[made.word], self.step, made.step, made.score)]

    def count(self, probabilities: np.ndarray) -> None:
        best = int(np.argmax(probabilities))
        for word in range(len(LABELS) - 1):
            p = float(probabilities[word])
            if p >= self.threshold(word) and (word == STOP or word == best):
                self.lowest[word] = min(p, self.lowest[word]) if self.streak[word] else p
                self.streak[word] += 1
            else:
                self.streak[word] = 0

    def threshold(self, word: int) -> float:
        if word == STOP:
            return self.rules.stop
        if word == 0 and self.stopped:
            return max(self.rules.directions[0], self.rules.forward_after_stop)
        return self.rules.directions[word]

    def isolated(self) -> bool:
        """Whether the waiting candidate may be reported now; one that never may is dropped."""
        assert self.waiting is not None
        if not self.rules.isolated:
            return True
        levels, waited_s = self.levels, (self.step - self.waiting.step) * STEP_S
        belongs = levels.open or (levels.frame - levels.last) * FRAME_S <= self.rules.reach_s + waited_s
        if (belongs and levels.too_long()) or (levels.open and waited_s >= self.rules.wait_max_s):
            self.waiting = None
        return self.waiting is not None and not levels.open


def detect(rules: Rules, probabilities: np.ndarray, levels: np.ndarray) -> list[Detection]:
    """All detections of a stream: probabilities float[steps, 5], levels float[steps, 8]."""
    recogniser = Recogniser(rules)
    return [found for p, l in zip(probabilities, levels) for found in recogniser.hear(p, l)]
