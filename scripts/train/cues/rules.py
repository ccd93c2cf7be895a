"""From probabilities to cues: the rules that the robot follows, pure and without a clock.

Time goes in steps of 20 ms. A step has the head's probabilities, and levels and periodicities of its two newest
frames of 10 ms.

Level. A frame's level in decibels is the mean over bands 4 to 27 (of 0 to 31) of its log-mel, less 2, times 10.

Floor. The level of what is always there. It begins at the first frame's level. A frame below the floor draws it down by
`floor_fall` of the distance; any other raises it by `floor_rise` decibels, but never above the frame.

stop. P(stop) >= threshold in `stop_steps` steps in a row. It is reported at once, ends what is waiting, and is not
reported again within `refractory`.

Directions. P(word) >= threshold and above all others in `direction_steps` steps in a row, and a voice is heard: a
candidate, unless a direction was reported within `refractory` or the same word is waiting already; another word's
candidate takes the waiting one's place. It is reported once it is isolated, in the step that made it a candidate or a
later one. *go* is reported as *forward*. After a stop, both need the threshold of `starts` until a direction was
reported.

Voice. Of the frames of the last `reach`, those of the step too, at least `voiced` have a periodicity of at least
`periodicity`, and the highest level is above `floor` + `above_floor`.

Talk. Of the frames of the last `talk`, without those of the last `reach` (the word itself is in those), at least
`talk_voiced` are voiced and not more than `talk_depth` below the peak of the last `reach`: that is talk beside the
word. A voice that is much softer, a television in the next room beside a handler who speaks into a microphone, is no
talk. In talk
1. no direction becomes a candidate; one that waits already goes on waiting;
2. *stop* has besides to be at or above `talk_stop` in `talk_stop_steps` steps in a row. Its score is their lowest.
   One that is not is in doubt: it ends what is waiting. When the next doubt begins within `AGAIN`, but not within
   `FLICKER`, of the first, it counts: it is said again. While the robot stands by a stop no stop is in doubt.

Isolation. When a candidate is made, after that step's levels were heard, a frame is called loud from then on if its
level is above `floor` + `margin` and above `peak` - `depth`, both as of then; peak is the highest level of the last
`reach`. In each step while it waits, from the newest frame back:
1. No frame is loud since `reach` before the candidate: it stands alone, it is reported.
2. From the last loud frame back to the first that has no gap of `quiet` without a loud frame behind it: that is the
   segment. If it is longer than `segment_max`, both ends counted, this is running speech: the candidate is dropped.
3. The last `quiet` are without a loud frame: it is reported.
4. It has waited for `wait_max`: it is dropped.
Levels and periodicities are remembered for `MEMORY`; what is older counts as not loud, and as not voiced.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from itertools import islice
from typing import NamedTuple

import numpy as np

from words import LABELS

# A stop in doubt counts that is said again so long after the first.
FLICKER_S, AGAIN_S = 0.4, 1.5
STEP_S, FRAME_S, FRAMES = 0.02, 0.01, 2
# Frames: no less than reach, wait_max (to the end of a step) and segment_max together, and no less than talk.
MEMORY = 640
DIRECTIONS = ("forward", "left", "right", "go")
STARTS = ("forward", "go")
# The cue of a word.
MEANT = {"go": "forward"}
STOP = LABELS.index("stop")
OTHER = LABELS.index("other")


@dataclass(frozen=True)
class Rules:
    stop: float = 0.7
    stop_steps: int = 3
    directions: tuple[float, ...] = (0.7, 0.7, 0.7, 0.7)  # in the order of DIRECTIONS
    direction_steps: int = 5
    starts: tuple[float, ...] = (0.85, 0.85)  # in the order of STARTS
    isolated: bool = True
    refractory_s: float = 1.0
    quiet_s: float = 0.18
    segment_max_s: float = 1.0
    wait_max_s: float = 0.6
    reach_s: float = 0.8
    margin_db: float = 8.0
    depth_db: float = 30.0
    floor_rise_db: float = 0.02
    floor_fall: float = 0.2
    periodicity: float = 0.7
    voiced_s: float = 0.03
    above_floor_db: float = 5.0
    talk_s: float = 6.0
    talk_voiced_s: float = 1.0
    talk_depth_db: float = 20.0
    talk_stop: float = 0.9
    talk_stop_steps: int = 8


class Detection(NamedTuple):
    cue: str
    step: int  # in which it is reported
    heard: int  # in which it became a candidate
    score: float  # the lowest of the probabilities that made it


class Candidate(NamedTuple):
    word: int
    step: int
    score: float
    loud_db: float


def nearest(number: float) -> int:
    """Halves up, as everywhere but in Python's own `round`; the nanosecond is for quotients that lack a bit."""
    return int(number + 0.5 + 1e-9)


def frames(seconds: float) -> int:
    return nearest(seconds / FRAME_S)


def steps(seconds: float) -> int:
    return nearest(seconds / STEP_S)


@dataclass
class Recogniser:
    rules: Rules = field(default_factory=Rules)
    stopped: bool = False

    def __post_init__(self) -> None:
        self.step = -1
        self.floor: float | None = None
        self.levels: deque[float] = deque(maxlen=MEMORY)
        self.periodicities: deque[float] = deque(maxlen=MEMORY)
        self.streak = [0] * len(LABELS)
        self.lowest = [1.0] * len(LABELS)
        self.surely, self.surely_lowest = 0, 1.0  # the same of a stop in talk
        self.doubted: int | None = None  # the step in which a doubt began
        self.stands = self.stopped
        self.waiting: Candidate | None = None
        self.silent_until = {"stop": 0, "direction": 0}

    def hear(self, probabilities: np.ndarray, levels: np.ndarray, periodicities: np.ndarray) -> list[Detection]:
        """What a step of float[6] makes known, with level float[2] and periodicity float[2] of its frames."""
        self.step += 1
        for level in levels:
            self.hear_level(float(level))
        self.periodicities.extend(map(float, periodicities))
        self.count(probabilities)
        refractory = steps(self.rules.refractory_s)
        score = self.stop_score()
        if score is None and self.streak[STOP] >= self.rules.stop_steps:
            self.waiting = None
        if score is not None:
            self.waiting, self.stopped = None, True
            if self.step < self.silent_until["stop"]:
                return []
            self.silent_until["stop"] = self.step + refractory
            return [Detection("stop", self.step, self.step, score)]
        for word in map(LABELS.index, DIRECTIONS):
            if self.streak[word] >= self.rules.direction_steps and self.step >= self.silent_until["direction"]:
                is_new = self.waiting is None or self.waiting.word != word
                if is_new and self.is_voice() and not self.in_talk():
                    self.waiting = Candidate(word, self.step, self.lowest[word], self.loud_db())
        if self.waiting is None or not self.isolated():
            return []
        made, self.waiting, self.stopped = self.waiting, None, False
        self.silent_until["direction"] = self.step + refractory
        word = LABELS[made.word]
        return [Detection(MEANT.get(word, word), self.step, made.step, made.score)]

    def hear_level(self, level: float) -> None:
        if self.floor is None:
            self.floor = level
        elif level < self.floor:
            self.floor += self.rules.floor_fall * (level - self.floor)
        else:
            self.floor = min(level, self.floor + self.rules.floor_rise_db)
        self.levels.append(level)

    def count(self, probabilities: np.ndarray) -> None:
        best = int(np.argmax(probabilities))
        for word in range(OTHER):
            p = float(probabilities[word])
            if p >= self.threshold(word) and (word == STOP or word == best):
                self.lowest[word] = min(p, self.lowest[word]) if self.streak[word] else p
                self.streak[word] += 1
            else:
                self.streak[word] = 0
        p = float(probabilities[STOP])
        is_sure = p >= self.rules.talk_stop
        self.surely_lowest = min(p, self.surely_lowest) if is_sure and self.surely else p
        self.surely = self.surely + 1 if is_sure else 0

    def stop_score(self) -> float | None:
        """The score of a stop that counts now."""
        if self.streak[STOP] < self.rules.stop_steps:
            return None
        if self.stands or not self.in_talk():
            return self.lowest[STOP]
        if self.surely >= self.rules.talk_stop_steps:
            return self.surely_lowest
        return self.lowest[STOP] if self.streak[STOP] == self.rules.stop_steps and self.is_again() else None

    def is_again(self) -> bool:
        """A doubt begins: whether it is the second of late."""
        before = None if self.doubted is None else self.step - self.doubted
        if before is not None and before < steps(FLICKER_S):
            return False
        self.doubted = self.step
        return before is not None and before <= steps(AGAIN_S)

    def threshold(self, word: int) -> float:
        if word == STOP:
            return self.rules.stop
        least = self.rules.directions[DIRECTIONS.index(LABELS[word])]
        if self.stopped and LABELS[word] in STARTS:
            return max(least, self.rules.starts[STARTS.index(LABELS[word])])
        return least

    def peak_db(self) -> float:
        reach = min(len(self.levels), frames(self.rules.reach_s))
        return max(self.levels[-i] for i in range(1, reach + 1))

    def is_voice(self) -> bool:
        """Whether a voice was heard of late, above what is always there."""
        assert self.floor is not None
        late = islice(reversed(self.periodicities), frames(self.rules.reach_s))
        voiced = sum(p >= self.rules.periodicity for p in late)
        return voiced >= frames(self.rules.voiced_s) and self.peak_db() > self.floor + self.rules.above_floor_db

    def in_talk(self) -> bool:
        """Whether it is talk: of late, and about as loud as what is heard now."""
        least, periodicity = self.peak_db() - self.rules.talk_depth_db, self.rules.periodicity
        sounds = zip(reversed(self.levels), reversed(self.periodicities))
        before = islice(sounds, frames(self.rules.reach_s), frames(self.rules.talk_s))
        return sum(p >= periodicity and level >= least for level, p in before) >= frames(self.rules.talk_voiced_s)

    def loud_db(self) -> float:
        """What is loud beside a candidate that is made now."""
        assert self.floor is not None
        return max(self.floor + self.rules.margin_db, self.peak_db() - self.rules.depth_db)

    def isolated(self) -> bool:
        """Whether the waiting candidate may be reported now; one that never may is dropped."""
        assert self.waiting is not None
        rules = self.rules
        if not rules.isolated:
            return True
        waited = self.step - self.waiting.step
        quiet = frames(rules.quiet_s)
        ages = [age for age, level in enumerate(reversed(self.levels)) if level > self.waiting.loud_db]
        if not ages or ages[0] >= frames(rules.reach_s) + FRAMES * waited:
            return True
        oldest = ages[0]
        for age in ages:
            if age - oldest > quiet:
                break
            oldest = age
        if oldest - ages[0] + 1 > frames(rules.segment_max_s):
            self.waiting = None
            return False
        if ages[0] >= quiet:
            return True
        if waited >= steps(rules.wait_max_s):
            self.waiting = None
        return False


def detect(
    rules: Rules, probabilities: np.ndarray, levels: np.ndarray, periodicities: np.ndarray, stopped: bool = False
) -> list[Detection]:
    """All detections of a stream: probabilities float[steps, 6], levels and periodicities float[steps, 2].

    Stopped: the robot stands by a stop as it begins.
    """
    recogniser = Recogniser(rules, stopped)
    return [found for step in zip(probabilities, levels, periodicities) for found in recogniser.hear(*step)]
