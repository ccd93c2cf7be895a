#!/usr/bin/env python3
"""Trains a policy by PPO with soft shielding (Kim et al. 2023, section 5.1)."""

import argparse
import json
import shlex
import sys
import time
from collections import defaultdict
from pathlib import Path

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback, CheckpointCallback, ProgressBarCallback

from shielded import Sectors, ShieldedPolicy
from teaching import teach
from vectors import Episodes

# Share of the episodes with "forward" in which that cue was given long before, unless an option says otherwise.
WALKED_BEFORE = 0.5


def parse():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    parser.add_argument("folder", type=Path, help="where checkpoints, TensorBoard logs and the model go")
    parser.add_argument("--steps", type=float, default=10e6, help="environment steps")
    parser.add_argument("--beta", type=float, default=0.5, help="the shield's suppression factor, 1: no shield")
    parser.add_argument("--noise", choices=["ideal", "noisy"], default="noisy")
    parser.add_argument("--harness", choices=["rigid", "delayed"], default="delayed")
    parser.add_argument("--handlers", choices=["nominal", "personal"], default="personal")
    parser.add_argument("--measure", choices=["line", "start"], default="line", help="what the reward is measured by")
    parser.add_argument("--frames", type=int, default=1, help="observations stacked")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--environments", type=int, default=64)
    parser.add_argument("--rollout", type=int, default=128, help="steps of each environment between updates")
    parser.add_argument("--batch", type=int, default=2048)
    parser.add_argument("--epochs", type=int, default=3)
    parser.add_argument("--learning-rate", type=float, default=4e-4, help="falls to 0")
    parser.add_argument("--clip", type=float, default=0.2, help="of PPO's ratio")
    parser.add_argument("--target-kl", type=float, help="an update ends where the policy has changed by so much")
    parser.add_argument("--entropy", type=float, default=0.01)
    parser.add_argument("--gamma", type=float, default=0.99)
    parser.add_argument("--width", type=int, default=128)
    parser.add_argument("--channels", type=int, default=16)
    parser.add_argument("--option", action="append", default=[], metavar="KEY=NUMBER", help="of the environment")
    parser.add_argument("--threads", type=int, default=1, help="of torch")
    parser.add_argument("--teach", type=float, default=0, help="environment steps of imitation before PPO")
    parser.add_argument("--checkpoint-every", type=float, default=500e3, help="environment steps")
    parser.add_argument(
        "--resume", action="store_true",
        help="go on from the newest checkpoint in the folder, if there is one, with the options that it was begun with",
    )
    parser.add_argument("--start", type=Path, help="begin with this model's weights")
    parser.add_argument("--sharpen", type=float, default=1, help="PPO begins with what was taught, drawn at this temperature")
    parser.add_argument("--quiet", action="store_true", help="no progress bar")
    return parser.parse_args()


class Reports(BaseCallback):
    """What became of the episodes, for TensorBoard and as lines of JSON."""

    def __init__(self, path):
        super().__init__()
        self.path, self.reports, self.begun = path, [], time.time()

    def _on_step(self):
        self.reports.extend(info["report"] for info in self.locals["infos"] if "report" in info)
        return True

    def _on_rollout_end(self):
        if not self.reports:
            return
        sums = defaultdict(list)
        for report in self.reports:
            sums["collision_free"].append(report["collisions"] == 0)
            sums[f"success_{report['cue']}"].append(report["success"])
            if report["cue"] in ("left", "right"):
                sums["success_stand" if report["to_stand"] else "success_turn"].append(report["success"])
            for key in ("collisions", "distance_m", "all_unsafe", "unsafe_taken", "reward", "hit_by_others"):
                sums[key].append(report[key])
        line = {key: float(np.mean(values)) for key, values in sums.items()}
        for key, value in line.items():
            self.logger.record(f"episodes/{key}", value)
        line |= {"steps": self.num_timesteps, "seconds": round(time.time() - self.begun, 1)}
        with self.path.open("a") as out:
            out.write(json.dumps(line) + "\n")
        self.reports.clear()


def checkpoint(arguments):
    """The newest one, where training goes on; all options but these are then those that it was begun with."""
    found = sorted(arguments.folder.glob("checkpoint_*_steps.zip"), key=lambda path: path.stat().st_mtime)
    if not (arguments.resume and found):
        return None
    begun = json.loads((arguments.folder / "arguments.json").read_text())
    for key in vars(arguments).keys() & begun.keys() - {"folder", "steps", "resume", "quiet", "threads"}:
        setattr(arguments, key, begun[key])
    return found[-1]


def main():
    arguments = parse()
    torch.set_num_threads(arguments.threads)
    folder = arguments.folder
    folder.mkdir(parents=True, exist_ok=True)
    newest = checkpoint(arguments)
    options = {key: float(value) for key, value in (text.split("=") for text in arguments.option)}
    options |= {"noise": arguments.noise, "harness": arguments.harness, "handlers": arguments.handlers}
    options |= {"measure": arguments.measure, "frames": arguments.frames}
    options.setdefault("walked_before", WALKED_BEFORE)
    said = {key: str(value) if isinstance(value, Path) else value for key, value in vars(arguments).items()}
    said["command"] = shlex.join(["python", *sys.argv])
    if not newest:
        (folder / "arguments.json").write_text(json.dumps(said | {"environment": options}, indent=2))
    environments = Episodes(arguments.environments, arguments.seed, **options)
    if newest:
        model = PPO.load(newest, environments)
        environments.seed(arguments.seed + model.num_timesteps)
    else:
        model = PPO(
            ShieldedPolicy,
            environments,
            learning_rate=lambda left: arguments.learning_rate * left,
            n_steps=arguments.rollout,
            batch_size=arguments.batch,
            n_epochs=arguments.epochs,
            gamma=arguments.gamma,
            clip_range=arguments.clip,
            target_kl=arguments.target_kl,
            ent_coef=arguments.entropy,
            seed=arguments.seed,
            tensorboard_log=str(folder / "tensorboard"),
            policy_kwargs={
                "beta": arguments.beta,
                "features_extractor_class": Sectors,
                "features_extractor_kwargs": {"width": arguments.width, "channels": arguments.channels},
            },
        )
        if arguments.start:
            model.set_parameters(arguments.start, exact_match=True)
        if arguments.teach:
            teach(model, environments, int(arguments.teach), folder / "teaching.jsonl")
            model.save(folder / "taught.zip")
        model.policy.sharpen(arguments.sharpen)
    callbacks = [
        Reports(folder / "progress.jsonl"),
        CheckpointCallback(max(int(arguments.checkpoint_every) // arguments.environments, 1), str(folder), "checkpoint"),
    ]
    if not arguments.quiet:
        callbacks.append(ProgressBarCallback())
    left = int(arguments.steps) - model.num_timesteps
    model.learn(left, callbacks, reset_num_timesteps=not newest)
    model.save(folder / "model.zip")


if __name__ == "__main__":
    main()
