"""A policy whose probabilities the shield has weighed (Kim et al. 2023, section 5, alg. 1 lines 8-12).

The probabilities of forbidden actions are multiplied by beta, in the logarithm, both when acting and when learning, so
that PPO's ratio is that of the actions that were really drawn. The network itself never sees what the shield says: on
the robot another process owns the shield, and only raw logits are exported.
"""

import copy
import math

import torch
from gymnasium import spaces
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import nn
from torch.distributions import Categorical, kl_divergence

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

    Without `share_features_extractor` what is to come is estimated from features of its own: what was taught is not
    forgotten over it. With `keeps` PPO's entropy is minus the divergence from what the policy was at `keep()`.
    """

    def __init__(self, *args, beta: float = 1.0, keeps: bool = False, **kwargs):
        self.beta = beta
        kwargs.setdefault("net_arch", [])
        kwargs.setdefault("features_extractor_class", Sectors)
        super().__init__(*args, **kwargs)
        # Made after the optimizer, which never sees it.
        self.kept = copy.deepcopy(self._actor()).requires_grad_(False) if keeps else None

    def _actor(self):
        return nn.Sequential(self.pi_features_extractor, self.action_net)

    def keep(self):
        """Learning keeps near to what the policy is now (Schmitt et al. 2018, Kickstarting)."""
        self.kept.load_state_dict(self._actor().state_dict())

    def latents(self, observations):
        """The policy's, and those from which what is to come is estimated."""
        of_policy = self.pi_features_extractor(observations)
        of_value = of_policy if self.share_features_extractor else self.vf_features_extractor(observations)
        return self.mlp_extractor.forward_actor(of_policy), self.mlp_extractor.forward_critic(of_value)

    def sharpen(self, temperature):
        """From now on actions are drawn as they were at this temperature: below 1 more surely."""
        with torch.no_grad():
            self.action_net.weight /= temperature
            self.action_net.bias /= temperature

    def _weighed(self, observations, latent):
        logits = suppressed(self.action_net(latent), observations["unsafe"], self.beta)
        return self.action_dist.proba_distribution(action_logits=logits)

    def _freedom(self, observations, distribution):
        """What PPO's entropy coefficient weighs."""
        if self.kept is None:
            return distribution.entropy()
        logits = suppressed(self.kept(observations), observations["unsafe"], self.beta)
        return -kl_divergence(Categorical(logits=logits), distribution.distribution)

    def forward(self, obs, deterministic=False):
        latent_pi, latent_vf = self.latents(obs)
        distribution = self._weighed(obs, latent_pi)
        actions = distribution.get_actions(deterministic=deterministic)
        return actions, self.value_net(latent_vf), distribution.log_prob(actions)

    def evaluate_actions(self, obs, actions):
        latent_pi, latent_vf = self.latents(obs)
        distribution = self._weighed(obs, latent_pi)
        return self.value_net(latent_vf), distribution.log_prob(actions), self._freedom(obs, distribution)

    def get_distribution(self, obs):
        latent_pi = self.mlp_extractor.forward_actor(self.pi_features_extractor(obs))
        return self._weighed(obs, latent_pi)
