"""One episode, and many side by side, as Gymnasium has them.

An observation has two parts: `senses`, what the policy sees (see `guidance::observation`), and `unsafe`, which actions the
shield forbids now. The policy's network sees the first; the second weighs its probabilities (soft shielding).
"""

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode

from guidedog_environment._native import ACTIONS, LENGTH, Episodes


def _spaces(frames):
    senses = gymnasium.spaces.Box(-4.0, 4.0, (frames * LENGTH,), np.float32)
    unsafe = gymnasium.spaces.MultiBinary(len(ACTIONS))
    return gymnasium.spaces.Dict(senses=senses, unsafe=unsafe), gymnasium.spaces.Discrete(len(ACTIONS))


def _whole(actions):
    """Actions as the native code takes them: a conversion would cut 1.7 down to 1 without a word."""
    actions = np.asarray(actions)
    if not np.issubdtype(actions.dtype, np.integer):
        raise TypeError(f"actions are whole numbers, not {actions.dtype}")
    return actions.astype(np.int64)


class Wayfinding(gymnasium.Env):
    """One cue, a hundred decisions. `options`: see the table in scripts/train/README.md."""

    metadata = {"render_modes": []}

    def __init__(self, **options):
        self._episodes = Episodes(1, options)
        self.observation_space, self.action_space = _spaces(options.get("frames", 1))
        self._ended = True

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        senses, unsafe = self._episodes.begin(int(self.np_random.integers(2**63)))
        self._ended = False
        return {"senses": senses[0], "unsafe": unsafe[0].astype(np.int8)}, {}

    def step(self, action):
        if self._ended:
            raise gymnasium.error.ResetNeeded("the episode has ended")
        senses, unsafe, rewards, finished = self._episodes.step(_whole([action]))
        if not finished:
            return {"senses": senses[0], "unsafe": unsafe[0].astype(np.int8)}, float(rewards[0]), False, False, {}
        self._ended = True
        (report,) = finished
        last = {"senses": report.pop("observation"), "unsafe": report.pop("unsafe").astype(np.int8)}
        # The hundredth decision ends the episode, not the task: it is cut short.
        return last, float(rewards[0]), False, True, report


class WayfindingVector(gymnasium.vector.VectorEnv):
    """Many episodes on all cores; one that ends is followed by another in the same step."""

    metadata = {"render_modes": [], "autoreset_mode": AutoresetMode.SAME_STEP}

    def __init__(self, num_envs=64, **options):
        self._episodes = Episodes(num_envs, options)
        self.num_envs = num_envs
        self.single_observation_space, self.single_action_space = _spaces(options.get("frames", 1))
        self.observation_space = gymnasium.vector.utils.batch_space(self.single_observation_space, num_envs)
        self.action_space = gymnasium.vector.utils.batch_space(self.single_action_space, num_envs)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        senses, unsafe = self._episodes.begin(int(self.np_random.integers(2**63)))
        return {"senses": senses, "unsafe": unsafe.astype(np.int8)}, {}

    def step(self, actions):
        senses, unsafe, rewards, finished = self._episodes.step(_whole(actions))
        truncated = np.zeros(self.num_envs, bool)
        infos = {}
        for report in finished:
            place = report.pop("place")
            truncated[place] = True
            final = {"senses": report.pop("observation"), "unsafe": report.pop("unsafe").astype(np.int8)}
            infos = self._add_info(infos, {"final_obs": final, "final_info": report}, place)
        observations = {"senses": senses, "unsafe": unsafe.astype(np.int8)}
        return observations, rewards, np.zeros(self.num_envs, bool), truncated, infos

    def taught(self):
        """What each action is worth in each episode now, metres of way, as the teacher says; -inf: forbidden."""
        return self._episodes.taught()
