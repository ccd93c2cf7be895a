"""Imitation before reinforcement (DAgger, Ross et al. 2011): the student walks, the teacher says what it would have done.

The teacher knows the travel line, the world and the handler (`shared/episodes/src/teacher.rs`); the student sees what a
robot sees. What is taught is the network's own choice, without the shield, so that it does not lean on it: not the best
action alone, but how much worse the others are, which is most of what there is to know where several are as good.
"""

import json
import time

import numpy as np
import torch
from torch.nn import functional
from torch.utils.tensorboard import SummaryWriter
from tqdm import tqdm

from guidedog_environment import ACTIONS
from models import save
from shielded import STOP

# Samples that are kept, and of those how many make an update.
KEPT = 1_200_000
BATCH = 2048
ROLLOUT = 64
UPDATES = 20
# Actions that the teacher takes to be worth so much less are e times less probable, metres of way.
INDIFFERENT_M = 0.02
# In so many of the episodes' decisions the teacher's own action is taken, at first.
LED = 0.5
# The student's own are drawn at a temperature that falls to this: it ends in the places to which it will come.
COOLED = 0.3
# The policy is saved after every so many steps.
SAVED = 100_000


class Samples:
    """The last samples, as halves of their precision: sectors and poses need no more."""

    def __init__(self, width):
        self.senses = np.zeros((KEPT, width), np.float16)
        self.taught = np.zeros((KEPT, len(ACTIONS)), np.float16)
        self.returns = np.zeros(KEPT, np.float32)
        self.count = 0

    def add(self, senses, taught, returns):
        places = np.arange(self.count, self.count + len(taught)) % KEPT
        self.senses[places], self.taught[places], self.returns[places] = senses, taught, returns
        self.count += len(taught)

    def draw(self, random):
        places = random.integers(min(self.count, KEPT), size=BATCH)
        return (
            torch.from_numpy(self.senses[places].astype(np.float32)),
            torch.from_numpy(self.taught[places].astype(np.float32)),
            torch.from_numpy(self.returns[places]),
        )


def teach(model, environments, steps, folder, quiet):
    """Teaches the policy, and its estimate of what is to come; a model that was taught before goes on from there."""
    policy, gamma = model.policy, model.gamma
    log, board = folder / "teaching.jsonl", SummaryWriter(folder / "tensorboard/teaching")
    samples = Samples(environments.observation_space["senses"].shape[0])
    random = np.random.default_rng(model.seed)
    optimizer = torch.optim.Adam(policy.parameters(), lr=1e-3)
    seen, begun, walked = environments.reset(), time.time(), getattr(model, "taught", 0)
    bar = tqdm(total=steps, initial=walked, desc="imitation", unit="step", disable=quiet)
    while walked < steps:
        left = 1.0 - walked / steps
        for group in optimizer.param_groups:
            group["lr"] = 1e-3 * max(left, 0.05)
        senses, taught, rewards, ends, cuts, reports = [], [], [], [], [], []
        policy.set_training_mode(False)
        for _ in range(ROLLOUT):
            told = wishes(environments.vector.taught())
            with torch.no_grad():
                logits = policy.get_distribution(policy.obs_to_tensor(seen)[0]).distribution.logits
                heat = COOLED + (1.0 - COOLED) * left
                own = torch.distributions.Categorical(logits=logits / heat).sample().numpy()
            led = random.random(len(told)) < LED * left
            senses.append(seen["senses"])
            taught.append(told)
            seen, reward, ended, infos = environments.step(np.where(led, told.argmax(axis=1), own))
            rewards.append(reward)
            ends.append(ended)
            cuts.append(_cut(policy, infos))
            reports.extend(info["report"] for info in infos if "report" in info)
            walked += len(told)
        with torch.no_grad():
            ahead = policy.predict_values(policy.obs_to_tensor(seen)[0]).numpy()[:, 0]
        returns = []
        for reward, ended, cut in zip(reversed(rewards), reversed(ends), reversed(cuts)):
            # An episode that was cut short would have gone on.
            ahead = reward + gamma * np.where(ended, cut, ahead)
            returns.append(ahead)
        samples_of_now = np.concatenate(taught)
        samples.add(np.concatenate(senses), samples_of_now, np.concatenate(returns[::-1]))
        policy.set_training_mode(True)
        losses = [_update(policy, optimizer, *samples.draw(random)) for _ in range(UPDATES)]
        line = {"steps": walked, "seconds": round(time.time() - begun, 1)}
        line |= {"imitation": float(np.mean([loss[0] for loss in losses])), "agreement": float(np.mean([loss[1] for loss in losses]))}
        if reports:
            line |= {"collision_free": float(np.mean([report["collisions"] == 0 for report in reports]))}
            line |= {"success": float(np.mean([report["success"] for report in reports]))}
            into = [report["success"] for report in reports if report["cue"] != "forward" and not report["to_stand"]]
            if into:
                line |= {"success_into": float(np.mean(into))}
        with log.open("a") as out:
            out.write(json.dumps(line) + "\n")
        for key in line.keys() - {"steps", "seconds"}:
            board.add_scalar(f"teaching/{key}", line[key], walked)
        bar.update(len(samples_of_now))
        model.taught = walked
        if walked // SAVED > (walked - len(samples_of_now)) // SAVED or walked >= steps:
            save(model, folder / "taught.zip")
    bar.close()
    board.close()


def wishes(worths_m):
    """How probable each action is with the teacher; certain to stand where all are forbidden."""
    worths_m = worths_m.copy()
    worths_m[np.isneginf(worths_m).all(axis=1), STOP] = 0.0
    likely = np.exp((worths_m - worths_m.max(axis=1, keepdims=True)) / INDIFFERENT_M)
    return (likely / likely.sum(axis=1, keepdims=True)).astype(np.float32)


def _cut(policy, infos):
    """What would have come of the episodes that were cut short."""
    ahead = np.zeros(len(infos), np.float32)
    for place, info in enumerate(infos):
        if "terminal_observation" in info:
            with torch.no_grad():
                ahead[place] = policy.predict_values(policy.obs_to_tensor(info["terminal_observation"])[0]).item()
    return ahead


def _update(policy, optimizer, senses, taught, returns):
    latent_pi, latent_vf = policy.latents({"senses": senses})
    logits = policy.action_net(latent_pi)
    imitation = functional.cross_entropy(logits, taught)
    value = functional.mse_loss(policy.value_net(latent_vf)[:, 0], returns)
    optimizer.zero_grad()
    (imitation + 0.02 * value).backward()
    torch.nn.utils.clip_grad_norm_(policy.parameters(), 1.0)
    optimizer.step()
    return imitation.item(), (logits.argmax(-1) == taught.argmax(-1)).float().mean().item()
