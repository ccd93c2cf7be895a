"""Imitation, PPO, resuming and export, in small (needs torch)."""

import json
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

torch = pytest.importorskip("torch")

import numpy as np  # noqa: E402
from stable_baselines3 import PPO  # noqa: E402

from shielded import Sectors, ShieldedPolicy  # noqa: E402
from vectors import REWARD_SCALE, Episodes  # noqa: E402

HERE = Path(__file__).resolve().parent.parent
SMALL = ["--quiet", "--environments=8", "--rollout=64", "--batch=128", "--width=16", "--channels=4"]


def run(script, *arguments, ends_with=0):
    """What it printed."""
    done = subprocess.run([sys.executable, str(HERE / script), *map(str, arguments)], capture_output=True, text=True)
    assert done.returncode == ends_with and "Traceback" not in done.stderr, done.stderr
    return done.stdout + done.stderr


def test_what_is_learnt_from_is_what_was_drawn():
    environments = Episodes(16, seed=1, noise="ideal")
    model = PPO(ShieldedPolicy, environments, n_steps=16, batch_size=64, policy_kwargs={
        "beta": 0.5, "features_extractor_class": Sectors, "features_extractor_kwargs": {"width": 16, "channels": 4}})
    seen = environments.reset()
    for _ in range(30):
        tensors, _ = model.policy.obs_to_tensor(seen)
        with torch.no_grad():
            actions, values, drawn = model.policy(tensors)
            again, learnt, _ = model.policy.evaluate_actions(tensors, actions)
        assert torch.allclose(drawn, learnt, atol=1e-5) and torch.allclose(values, again, atol=1e-5)
        seen, *_ = environments.step(actions.numpy())


def test_an_episode_that_is_cut_short_is_told_with_what_was_seen_last():
    environments = Episodes(4, seed=1, noise="ideal", decisions=5)
    environments.reset()
    told = []
    for _ in range(10):
        seen, rewards, ended, infos = environments.step(np.ones(4, int))
        for place in np.flatnonzero(ended):
            info = infos[place]
            assert info["TimeLimit.truncated"]
            assert info["terminal_observation"]["senses"].shape == seen["senses"][place].shape
            assert not np.array_equal(info["terminal_observation"]["senses"], seen["senses"][place])
            told.append(info["episode"])
    assert told and all(one["l"] <= 5 for one in told)
    assert np.abs(rewards).max() <= 2 * REWARD_SCALE


def test_training_goes_on_where_it_was_and_is_exported(tmp_path):
    run("train.py", tmp_path, "--steps=1024", "--checkpoint-every=512", "--teach=512", "--beta=0.9", *SMALL)
    run("train.py", tmp_path, "--steps=2048", "--resume", "--quiet")
    begun = json.loads((tmp_path / "arguments.json").read_text())
    assert begun["beta"] == 0.9 and begun["teach"] == 512
    model = PPO.load(tmp_path / "model.zip")
    assert model.num_timesteps == 2048 and model.policy.beta == 0.9
    run("export.py", tmp_path, tmp_path / "small.onnx")
    manifest = tomllib.loads((tmp_path / "small.toml").read_text())
    assert manifest["trained"]["taught"] == 512 and manifest["trained"]["steps"] == 2048
    assert manifest["trained"]["beta"] == 0.9 and (tmp_path / "small.onnx").stat().st_size > 1000


def test_a_model_beyond_the_last_checkpoint_is_gone_on_from_and_a_whole_one_left(tmp_path):
    run("train.py", tmp_path, "--steps=512", "--checkpoint-every=1e6", *SMALL)
    there = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")}
    assert "nothing is left to do" in run("train.py", tmp_path, "--steps=512", "--resume", "--quiet")
    assert there == {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")}
    run("train.py", tmp_path, "--steps=1024", "--resume", "--quiet")
    assert PPO.load(tmp_path / "model.zip").num_timesteps == 1024


def test_what_is_torn_is_told_and_what_was_saved_before_gone_on_from(tmp_path):
    run("train.py", tmp_path, "--steps=512", "--checkpoint-every=256", *SMALL)
    for name in ("checkpoint_512_steps.zip", "model.zip"):
        (tmp_path / name).write_bytes((tmp_path / name).read_bytes()[:2000])
    assert run("export.py", tmp_path, tmp_path / "small.onnx", ends_with=1).count("\n") == 1
    told = run("train.py", tmp_path, "--steps=768", "--resume", "--quiet")
    assert "checkpoint_512_steps.zip cannot be gone on from" in told and "model.zip cannot" in told
    assert PPO.load(tmp_path / "model.zip").num_timesteps == 768
    assert not [*tmp_path.glob("*.part"), *tmp_path.glob("small.*"), *tmp_path.glob(".export-*")]
    begun = tmp_path / "arguments.json"
    for odd in ("", "[]", begun.read_text().replace('"beta": 0.5', '"beta": 7')):
        begun.write_text(odd)
        assert str(begun) in run("train.py", tmp_path, "--steps=2048", "--resume", "--quiet", ends_with=1)


@pytest.mark.parametrize("script, words", [
    ("train.py", ["--option=foo"]), ("train.py", ["--option=frames=2"]), ("train.py", ["--option=colour=1"]), ("train.py", ["--environments=0"]),
    ("train.py", ["--steps=nan"]), ("train.py", ["--steps=0"]), ("train.py", ["--beta=1.1"]),
    ("export.py", ["small.onnx"]), ("export.py", ["small.pt"]), ("export.py", ["small.onnx", "--temperature=0"]),
    ("export.py", ["small.onnx", "--temperature=nan"]),
])
def test_wrong_arguments_are_told_before_anything_is_written(tmp_path, script, words):
    run(script, tmp_path, *(tmp_path / word if word.startswith("small") else word for word in words), ends_with=2)
    assert not list(tmp_path.iterdir())


def test_imitation_goes_on_where_it_was(tmp_path):
    run("train.py", tmp_path, "--steps=0", "--teach=512", *SMALL)
    assert "--resume goes on with it" in run("train.py", tmp_path, "--steps=0", "--teach=512", *SMALL, ends_with=2)
    (tmp_path / "model.zip").unlink()
    begun = tmp_path / "arguments.json"
    begun.write_text(begun.read_text().replace('"teach": 512', '"teach": 1024'))
    run("train.py", tmp_path, "--steps=0", "--resume", "--quiet")
    assert PPO.load(tmp_path / "model.zip").taught == 1024
    steps = [json.loads(line)["steps"] for line in (tmp_path / "teaching.jsonl").read_text().splitlines()]
    assert steps == [512, 1024]


def test_what_was_taught_is_kept_to(tmp_path):
    run("train.py", tmp_path / "taught", "--steps=0", "--teach=512", *SMALL)
    start = ["--start", tmp_path / "taught/taught.zip", "--estimate=512", *SMALL]
    apart = {}
    for keep in ("0", "1000"):
        run("train.py", tmp_path / keep, "--steps=1024", f"--keep={keep}", "--learning-rate=0.01", *start)
        taught, learnt = (PPO.load(path).policy.action_net.weight for path in (start[1], tmp_path / keep / "model.zip"))
        apart[keep] = (taught - learnt).norm().item()
    assert 0 < apart["1000"] < apart["0"]


def test_what_was_sharpened_is_not_sharpened_again(tmp_path):
    run("train.py", tmp_path, "--steps=0", "--teach=512", "--sharpen=0.5", *SMALL)
    weight = PPO.load(tmp_path / "model.zip").policy.action_net.weight
    run("train.py", tmp_path, "--steps=512", "--resume", "--quiet")
    assert torch.allclose(weight, PPO.load(tmp_path / "model.zip").policy.action_net.weight, rtol=0.3, atol=1e-3)
