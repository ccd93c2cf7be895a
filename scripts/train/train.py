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

from models import begin_with, newest, save, saved
from options import ABOVE_0, AT_LEAST_0, COUNT, SEED, SHARE, pair, pair_text, read_json
from shielded import Sectors, ShieldedPolicy
from teaching import teach
from vectors import Episodes

# Share of the episodes with "forward" in which that cue was given long before, unless an option says otherwise.
WALKED_BEFORE = 0.5
# Options of the environment that are options here.
OF_THEIR_OWN = {"noise", "harness", "handlers", "measure", "frames"}
# Who resumes says these anew; all other options are those that training was begun with.
SAID_ANEW = {"folder", "steps", "resume", "quiet", "threads"}


def options():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    parser.add_argument("folder", type=Path, help="where checkpoints, TensorBoard logs and the model go")
    parser.add_argument("--steps", type=AT_LEAST_0, default=10e6, help="environment steps")
    parser.add_argument("--beta", type=SHARE, default=0.5, help="the shield's suppression factor, 1: no shield")
    parser.add_argument("--noise", choices=["ideal", "noisy", "legged"], default="noisy")
    parser.add_argument("--harness", choices=["rigid", "delayed"], default="delayed")
    parser.add_argument("--handlers", choices=["nominal", "personal"], default="personal")
    parser.add_argument("--measure", choices=["line", "start"], default="line", help="what the reward is measured by")
    parser.add_argument("--frames", type=COUNT, default=1, help="observations stacked")
    parser.add_argument("--seed", type=SEED, default=0)
    parser.add_argument("--environments", type=COUNT, default=64)
    parser.add_argument("--rollout", type=COUNT, default=128, help="steps of each environment between updates")
    parser.add_argument("--batch", type=COUNT, default=2048)
    parser.add_argument("--epochs", type=COUNT, default=3)
    parser.add_argument("--learning-rate", type=ABOVE_0, default=4e-4, help="falls to 0")
    parser.add_argument("--clip", type=ABOVE_0, default=0.2, help="of PPO's ratio")
    parser.add_argument("--target-kl", type=ABOVE_0, help="an update ends where the policy has changed by so much")
    parser.add_argument("--entropy", type=AT_LEAST_0, default=0.01)
    parser.add_argument(
        "--keep", type=AT_LEAST_0, default=0,
        help="weight of the divergence from what was taught, which takes the entropy's place",
    )
    parser.add_argument("--gamma", type=SHARE, default=0.99)
    parser.add_argument("--width", type=COUNT, default=128)
    parser.add_argument("--channels", type=COUNT, default=16)
    parser.add_argument(
        "--option", type=pair_text, action="append", default=[], metavar="KEY=NUMBER", help="of the environment",
    )
    parser.add_argument("--threads", type=COUNT, default=1, help="of torch")
    parser.add_argument("--teach", type=AT_LEAST_0, default=0, help="environment steps of imitation before PPO")
    parser.add_argument("--checkpoint-every", type=ABOVE_0, default=500e3, help="environment steps")
    parser.add_argument(
        "--resume", action="store_true",
        help="go on from what was saved last in the folder, if there is any, with the options that it was begun with",
    )
    parser.add_argument("--start", type=Path, help="begin with this model's weights")
    parser.add_argument(
        "--estimate", type=AT_LEAST_0, default=0,
        help="environment steps before PPO that fit the estimate of what is to come, from features of its own",
    )
    parser.add_argument(
        "--sharpen", type=ABOVE_0, default=1, help="PPO begins with what was taught, drawn at this temperature",
    )
    parser.add_argument("--quiet", action="store_true", help="no progress bar")
    return parser


def parse(parser, words=None):
    given = parser.parse_args(words)
    if twice := OF_THEIR_OWN & dict(map(pair, given.option)).keys():
        parser.error(f"--option {min(twice)}: that is --{min(twice)}")
    if given.steps < 1 and not (given.teach or given.resume):
        parser.error("--steps 0 leaves nothing to do without --teach")
    return given


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


class Checkpoints(CheckpointCallback):
    def _on_step(self):
        if self.n_calls % self.save_freq == 0:
            save(self.model, Path(self._checkpoint_path(extension="zip")))
        return True


def restore(parser, arguments):
    """All options but those that are said anew as training was begun with them, and within the same bounds."""
    path = arguments.folder / "arguments.json"
    begun = read_json(path)
    words = [str(arguments.folder), f"--steps={arguments.steps}"]
    for key in vars(arguments).keys() & begun.keys() - SAID_ANEW:
        values = begun[key] if key == "option" and isinstance(begun[key], list) else [begun[key]]
        words += [f"--{key.replace('_', '-')}={value}" for value in values if value is not None]
    parser.exit_on_error = False
    try:
        told = vars(parse(parser, words))
    except argparse.ArgumentError as error:
        raise SystemExit(f"{path}: {error}") from None
    for key in told.keys() & begun.keys() - SAID_ANEW:
        setattr(arguments, key, told[key])


def estimate(model, steps):
    """Fits the estimate of what is to come to the policy, before the policy is moved by it."""
    of_value = ("value_net", "vf_features_extractor")
    named = model.policy.named_parameters()
    policy = [each for name, each in named if each.requires_grad and not name.startswith(of_value)]
    for each in policy:
        each.requires_grad_(False)
    schedule, model.lr_schedule = model.lr_schedule, lambda left: 1e-3 * left
    model.learn(steps)
    model.lr_schedule, model.num_timesteps = schedule, 0
    for each in policy:
        each.requires_grad_(True)


def begin(arguments, environments):
    """A new model."""
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
        ent_coef=arguments.keep or arguments.entropy,
        seed=arguments.seed,
        tensorboard_log=str(arguments.folder / "tensorboard"),
        policy_kwargs={
            "beta": arguments.beta,
            "keeps": arguments.keep > 0,
            "share_features_extractor": not arguments.estimate,
            "features_extractor_class": Sectors,
            "features_extractor_kwargs": {"width": arguments.width, "channels": arguments.channels},
        },
    )
    if arguments.start:
        begin_with(model.policy, arguments.start)
    return model


def prepare(model, arguments, environments):
    """What comes before PPO."""
    if arguments.teach:
        teach(model, environments, int(arguments.teach), arguments.folder, arguments.quiet)
    model.policy.sharpen(arguments.sharpen)
    if arguments.keep:
        model.policy.keep()
    if arguments.estimate:
        estimate(model, int(arguments.estimate))


def main():
    parser = options()
    arguments = parse(parser)
    torch.set_num_threads(arguments.threads)
    folder = arguments.folder
    found = saved(folder)
    if found and not arguments.resume:
        parser.error(f"{folder} holds a training: --resume goes on with it")
    if found:
        restore(parser, arguments)
    environment = dict(map(pair, arguments.option))
    environment |= {"noise": arguments.noise, "harness": arguments.harness, "handlers": arguments.handlers}
    environment |= {"measure": arguments.measure, "frames": arguments.frames}
    environment.setdefault("walked_before", WALKED_BEFORE)
    try:
        environments = Episodes(arguments.environments, arguments.seed, **environment)
    except (TypeError, ValueError) as error:
        parser.error(str(error))
    folder.mkdir(parents=True, exist_ok=True)
    if found:
        model, path = newest(found, environments)
        environments.seed(arguments.seed + model.num_timesteps + getattr(model, "taught", 0))
    else:
        said = {key: str(value) if isinstance(value, Path) else value for key, value in vars(arguments).items()}
        said["command"] = shlex.join(["python", *sys.argv])
        (folder / "arguments.json").write_text(json.dumps(said | {"environment": environment}, indent=2))
        model, path = begin(arguments, environments), None
    left = int(arguments.steps) - model.num_timesteps
    # What has only been taught, perhaps not to its end, is not prepared yet.
    begins = path is None or path.name == "taught.zip"
    if not begins and left <= 0:
        done = f"{path}: {model.num_timesteps} of {int(arguments.steps)} steps are done"
        if path.name == "model.zip":
            print(f"{done}, nothing is left to do")
        else:
            # Training was stopped between its last checkpoint and its end.
            save(model, folder / "model.zip")
            print(f"{done}, model.zip is made of them")
        return
    if begins:
        prepare(model, arguments, environments)
    every = max(int(arguments.checkpoint_every) // arguments.environments, 1)
    callbacks = [Reports(folder / "progress.jsonl"), Checkpoints(every, str(folder), "checkpoint")]
    if not arguments.quiet:
        callbacks.append(ProgressBarCallback())
    model.learn(left, callbacks, reset_num_timesteps=begins)
    save(model, folder / "model.zip")


if __name__ == "__main__":
    main()
