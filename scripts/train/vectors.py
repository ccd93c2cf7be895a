"""The batch of episodes as stable-baselines3 has its environments."""

import numpy as np
from stable_baselines3.common.vec_env import VecEnv

from guidedog_environment import WayfindingVector

# Returns are of the order of 1 so: what the value's error weighs beside the policy's is then what it should.
REWARD_SCALE = 0.1


class Episodes(VecEnv):
    """All episodes are stepped at once, on all cores. The hundredth decision cuts an episode short: it is told as
    truncation, with the last observation, so that what would have come is estimated and not taken as nothing."""

    def __init__(self, count: int, seed: int, **options):
        self.vector = WayfindingVector(count, **options)
        self._seed = seed
        super().__init__(count, self.vector.single_observation_space, self.vector.single_action_space)

    def reset(self):
        """Other episodes each time: what is taught, estimated and learnt in turn begins with none of those before."""
        observations, _ = self.vector.reset(seed=self._seed)
        self._seed = None
        return observations

    def step_async(self, actions):
        self._actions = actions

    def step_wait(self):
        observations, rewards, _, truncated, told = self.vector.step(self._actions)
        infos = [{} for _ in range(self.num_envs)]
        for place in np.flatnonzero(truncated):
            report = {key: values[place] for key, values in told["final_info"].items() if not key.startswith("_")}
            infos[place] = {
                "terminal_observation": told["final_obs"][place],
                "TimeLimit.truncated": True,
                "report": report,
                "episode": {"r": float(report["reward"]), "l": int(report["decisions"]), "t": 0.0},
            }
        return observations, (REWARD_SCALE * rewards).astype(np.float32), truncated, infos

    def close(self):
        pass

    def seed(self, seed=None):
        if seed is not None:
            self._seed = seed
        return [seed] * self.num_envs

    def get_attr(self, attr_name, indices=None):
        return [getattr(self.vector, attr_name, None) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name, value, indices=None):
        raise NotImplementedError("the episodes are one batch")

    def env_method(self, method_name, *args, indices=None, **kwargs):
        raise NotImplementedError("the episodes are one batch")

    def env_is_wrapped(self, wrapper_class, indices=None):
        return [False for _ in self._get_indices(indices)]
