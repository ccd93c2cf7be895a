"""Models as they are saved: whole or not at all, and what a training can go on from."""

import sys

from stable_baselines3 import PPO
from stable_baselines3.common.save_util import load_from_zip_file

# What a file raises that holds no model of ours.
UNREADABLE = (OSError, ValueError, KeyError, TypeError, AssertionError)


def save(model, path):
    """Whole or not at all: who is stopped at it goes on from what was saved before."""
    part = path.with_suffix(".part")
    model.save(part)
    part.replace(path)


def saved(folder):
    """What training can go on from, the newest first; the model is written last."""
    found = [*folder.glob("taught.zip"), *folder.glob("checkpoint_*_steps.zip"), *folder.glob("model.zip")]
    return sorted(found, key=lambda path: (path.stat().st_mtime_ns, path.name), reverse=True)


def newest(found, environments):
    """The newest model that can be read, and where it lay."""
    for path in found:
        try:
            return PPO.load(path, environments), path
        except UNREADABLE as error:
            print(f"{path} cannot be gone on from: {error}", file=sys.stderr)
    raise SystemExit(f"{found[0].parent} holds nothing to go on from; in another folder training begins anew")


def begin_with(policy, path):
    """The weights of another training; what is to come is estimated from the same features, at first."""
    _, parameters, _ = load_from_zip_file(path, device="cpu")
    weights = {key: value for key, value in parameters["policy"].items() if not key.startswith("kept.")}
    weights |= {f"vf_{key}": value for key, value in weights.items() if key.startswith("features_extractor.")}
    weights |= {key: value for key, value in policy.state_dict().items() if key.startswith("kept.")}
    policy.load_state_dict(weights)
