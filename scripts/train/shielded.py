"""A policy whose probabilities the shield has weighed (Kim et al. 2023, section 5, alg. 1 lines 8-12).

The probabilities of forbidden actions are multiplied by beta, in the logarithm, both when acting and when learning, so
that PPO's ratio is that of the actions that were really drawn. The network itself never sees what the shield says: on
the robot another process owns the shield, and only raw logits are exported.
"""

import math

import torch
from gymnasium import spaces
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import nn

from guidedog_environment import CHANNELS, LENGTH, SECTORS, STATE

STOP = 0
# What stands for the logarithm of 0.
NEVER = -1e8


def suppressed(logits: torch.Tensor, unsafe: torch.Tensor, beta: float) -> torch.Tensor:
    """The logits after the shield. Where every action is unsafe, beta 0 leaves stop, any other beta what there was."""
    unsafe = unsafe > 0.5
    if beta > 0.0:
        return logits + unsafe * math.log(beta)
    none_left = unsafe.all(dim=-1, keepdim=True)
    only_stop = torch.ones_like(unsafe)
    only_stop[..., STOP] = False
    return logits.masked_fill(torch.where(none_left, only_stop, unsafe), NEVER)


class Sectors(BaseFeaturesExtractor):
    """Convolutions round the circle of sectors, then the state beside them; of several frames each is a set of channels."""

    def __init__(self, observation_space: spaces.Dict, width: int = 128, channels: int = 16):
        super().__init__(observation_space, width)
        self.frames = observation_space["senses"].shape[0] // LENGTH
        self.layers = nn.ModuleList([
            nn.Conv1d(CHANNELS * self.frames, channels, 5, stride=2),
            nn.Conv1d(channels, 2 * channels, 5, stride=2),
            nn.Conv1d(2 * channels, 2 * channels, 3, stride=2),
        ])
        flat = 2 * channels * (SECTORS // 8)
        self.look = nn.Sequential(nn.Linear(flat, width), nn.ReLU())
        self.state = nn.Sequential(nn.Linear(STATE * self.frames, 32), nn.ReLU())
        self.mix = nn.Sequential(nn.Linear(width + 32, width), nn.ReLU())

    def forward(self, observations: dict[str, torch.Tensor]) -> torch.Tensor:
        frames = observations["senses"].reshape(-1, self.frames, LENGTH)
        x = frames[..., : CHANNELS * SECTORS].reshape(-1, self.frames * CHANNELS, SECTORS)
        for layer in self.layers:
            side = layer.kernel_size[0] // 2
            x = torch.cat([x[..., -side:], x, x[..., :side]], dim=-1)
            x = torch.relu(layer(x))
        state = frames[..., CHANNELS * SECTORS :].reshape(-1, self.frames * STATE)
        return self.mix(torch.cat([self.look(x.flatten(1)), self.state(state)], dim=-1))


class ShieldedPolicy(ActorCriticPolicy):
    """An actor-critic whose distribution is the shield's.

    With `apart`, what is to come is estimated from the policy's features and does not shape them: what was taught is not
    forgotten over it.
    """

    def __init__(self, *args, beta: float = 1.0, apart: bool = False, **kwargs):
        self.beta, self.apart = beta, apart
        kwargs.setdefault("net_arch", [])
        kwargs.setdefault("features_extractor_class", Sectors)
        super().__init__(*args, **kwargs)

    def _get_constructor_parameters(self):
        return super()._get_constructor_parameters() | {"beta": self.beta, "apart": self.apart}

    def sharpen(self, temperature):
        """From now on actions are drawn as they were at this temperature: below 1 more surely."""
        with torch.no_grad():
            self.action_net.weight /= temperature
            self.action_net.bias /= temperature

    def _estimate(self, latent):
        return self.value_net(latent.detach() if self.apart else latent)

    def _weighed(self, observations, latent):
        logits = suppressed(self.action_net(latent), observations["unsafe"], self.beta)
        return self.action_dist.proba_distribution(action_logits=logits)

    def forward(self, obs, deterministic=False):
        latent_pi, latent_vf = self.mlp_extractor(self.extract_features(obs))
        distribution = self._weighed(obs, latent_pi)
        actions = distribution.get_actions(deterministic=deterministic)
        return actions, self._estimate(latent_vf), distribution.log_prob(actions)

    def evaluate_actions(self, obs, actions):
        latent_pi, latent_vf = self.mlp_extractor(self.extract_features(obs))
        distribution = self._weighed(obs, latent_pi)
        return self._estimate(latent_vf), distribution.log_prob(actions), distribution.entropy()

    def get_distribution(self, obs):
        latent_pi, _ = self.mlp_extractor(self.extract_features(obs))
        return self._weighed(obs, latent_pi)
