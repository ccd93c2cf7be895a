#!/usr/bin/env python3
"""Writes a trained policy as ONNX with its manifest: raw logits, never the shield."""

import argparse
import hashlib
import json
import tempfile
from pathlib import Path

import numpy as np
import onnxruntime
import torch
from stable_baselines3 import PPO

import actions
from guidedog_environment import ACTION_TABLE_ID, OBSERVATION, Episodes
from models import UNREADABLE
from options import ABOVE_0, read_json


class Logits(torch.nn.Module):
    def __init__(self, policy):
        super().__init__()
        self.policy = policy

    def forward(self, senses):
        features = self.policy.features_extractor({"senses": senses})
        return self.policy.action_net(self.policy.mlp_extractor.forward_actor(features))


def export(model, path):
    """Writes the network; its greatest difference to torch over observations that never were."""
    network = Logits(model.policy).eval().cpu()
    width = model.observation_space["senses"].shape[0]
    # The legacy exporter: its graph is of plain operators, which tract runs as well.
    torch.onnx.export(
        network, (torch.rand(1, width),), str(path), dynamo=False, opset_version=17,
        input_names=["senses"], output_names=["logits"],
    )
    session = onnxruntime.InferenceSession(str(path))
    worst = 0.0
    for _ in range(256):
        senses = torch.rand(1, width)
        (logits,) = session.run(None, {"senses": senses.numpy()})
        with torch.no_grad():
            worst = max(worst, float(np.abs(logits - network(senses).numpy()).max()))
    return worst


def scored(report):
    """What it scored, by a report of `guidedog evaluate --json`."""
    mean = {
        "collision_free": report["collision_free"], "collisions_per_episode": report["collisions_per_episode"],
        "cues_followed": report["cue_success"]["all"], "into_an_opening": report["cue_success"]["turn_taken"],
        "distance_m": report["distance_m"],
    }
    lines = [f"{key} = {value['mean']:.4f}" for key, value in mean.items()]
    return "\n".join(["", "[scores]", f'noise = "{report["noise"]}"', f"episodes = {report['episodes']}", *lines, ""])


def taught(arguments):
    """Steps of imitation, in this training and in the one with whose weights it began."""
    before = arguments["start"] and Path(arguments["start"]).with_name("arguments.json")
    return int(arguments["teach"]) + (taught(read_json(before)) if before else 0)


def manifest(path, arguments, steps, command, temperature):
    about = Episodes(1, options=arguments["environment"]).about()
    keys = ("alpha", "offset_x_m", "offset_y_m")
    ranges = "\n".join(f"{key} = [{least:.2f}, {most:.2f}]" for key, (least, most) in ((key, about[key]) for key in keys))
    return f"""\
sha256 = "{hashlib.sha256(path.read_bytes()).hexdigest()}"
observation = "{OBSERVATION}"
actions = "{actions.name_of(ACTION_TABLE_ID)}"
dt = "{about["dt_ms"]}ms"
frames = {arguments["frames"]}
temperature = {temperature}

[trained]
steps = {steps}
taught = {taught(arguments)}
beta = {arguments["beta"]}
noise = "{arguments["noise"]}"
harness = "{arguments["harness"]}"
depth = {json.dumps(about["depth"])}
memory = {json.dumps(about["memory"])}
seed = {arguments["seed"]}
{ranges}
command = {json.dumps(command)}
"""


def parse():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="of the training")
    parser.add_argument("output", type=Path, help="NAME.onnx; NAME.toml goes beside it")
    parser.add_argument("--checkpoint", type=Path, help="instead of the folder's model.zip")
    parser.add_argument("--command", help="that makes it again, as the manifest tells it; the training's own otherwise")
    parser.add_argument("--scores", type=Path, help="a report of `guidedog evaluate --json`, for the manifest")
    parser.add_argument("--temperature", type=ABOVE_0, default=1.0, help="below 1 actions are drawn more surely")
    given = parser.parse_args()
    given.model = given.checkpoint or given.folder / "model.zip"
    if given.output.suffix != ".onnx":
        parser.error(f"{given.output} does not end in .onnx")
    for path in (given.model, given.folder / "arguments.json"):
        if not path.is_file():
            parser.error(f"there is no {path}")
    return given


def load(path):
    try:
        return PPO.load(path, device="cpu")
    except UNREADABLE as error:
        raise SystemExit(f"{path} is no model: {error}") from None


def described(given, network, steps):
    """The manifest of an exported network."""
    path = given.folder / "arguments.json"
    arguments = read_json(path)
    try:
        text = manifest(network, arguments, steps, given.command or arguments["command"], given.temperature)
    except (KeyError, TypeError, ValueError) as error:
        raise SystemExit(f"{path} is not what train.py writes: {error!r}") from None
    if not given.scores:
        return text
    try:
        return text + scored(read_json(given.scores))
    except (KeyError, TypeError, ValueError) as error:
        raise SystemExit(f"{given.scores} is no report of guidedog evaluate: {error!r}") from None


def main():
    given = parse()
    model = load(given.model)
    given.output.parent.mkdir(parents=True, exist_ok=True)
    # Beside where it goes, so that nothing but whole and verified files ever has their names.
    with tempfile.TemporaryDirectory(dir=given.output.parent, prefix=".export-") as scratch:
        network = Path(scratch) / given.output.name
        worst = export(model, network)
        if not worst < 1e-4:
            raise SystemExit(f"the exported network differs from torch by {worst}")
        text = described(given, network, model.num_timesteps)
        network.with_suffix(".toml").write_text(text)
        network.replace(given.output)
        network.with_suffix(".toml").replace(given.output.with_suffix(".toml"))
    print(f"{given.output}: {given.output.stat().st_size} bytes, differs from torch by at most {worst:.1e}")


if __name__ == "__main__":
    main()
