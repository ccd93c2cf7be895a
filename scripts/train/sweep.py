#!/usr/bin/env python3
"""Trains the policies of Kim et al.'s table 3 (beta x noise x seed), or table 2 (harness x seed), through Ray Tune: on this
machine, or on the cluster that RAY_ADDRESS names. On a cluster FOLDER is one that all its machines share, and the project
lies at the same path on each, with its scripts/train/setup done there."""

import argparse
import os
import subprocess
import sys
from pathlib import Path

from ray import tune

from options import ABOVE_0, COUNT

HERE = Path(__file__).parent.resolve()


def parse():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    parser.add_argument("table", choices=["2", "3"])
    parser.add_argument("folder", type=Path, help="for each policy a folder with its policy.onnx; what is there is not trained again")
    parser.add_argument("--steps", type=ABOVE_0, default=1e6, help="environment steps of each policy")
    parser.add_argument("--seeds", type=COUNT, default=3)
    parser.add_argument("--cores", type=ABOVE_0, default=1, help="of each training")
    parser.add_argument("rest", nargs="*", help="more for train.py, after --")
    return parser.parse_args()


def space(table, seeds):
    if table == "2":
        cells = [{"harness": harness, "noise": "noisy", "beta": 0.5} for harness in ("rigid", "delayed")]
    else:
        cells = [
            {"harness": "delayed", "noise": noise, "beta": beta}
            for noise in ("ideal", "noisy")
            for beta in (0.0, 0.1, 0.5, 0.9, 1.0)
        ]
    return [cell | {"seed": seed} for cell in cells for seed in range(seeds)]


def name(cell):
    return f"{cell['harness']}-{cell['noise']}-beta{cell['beta']}-seed{cell['seed']}"


def train(config):
    """One policy, in a process of its own: what a worker on another machine does as well."""
    cell, folder = config["cell"], Path(config["folder"]) / name(config["cell"])
    # Trainings share a machine: none takes more of its cores than it was given.
    environment = os.environ | {"RAYON_NUM_THREADS": str(max(int(config["cores"]), 1))}
    if not (folder / "model.zip").exists():
        arguments = [f"--{key}={value}" for key, value in cell.items()]
        command = [sys.executable, str(HERE / "train.py"), str(folder), "--quiet", "--resume"]
        command += [f"--steps={config['steps']}", *arguments, *config["rest"]]
        subprocess.run(command, check=True, env=environment)
    if not (folder / "policy.onnx").exists():
        subprocess.run([sys.executable, str(HERE / "export.py"), str(folder), str(folder / "policy.onnx")], check=True)
    tune.report({"done": 1})


def main():
    given = parse()
    folder = given.folder.resolve()
    cells = space(given.table, given.seeds)
    trainable = tune.with_resources(train, {"cpu": given.cores})
    common = {"folder": str(folder), "steps": given.steps, "cores": given.cores, "rest": given.rest}
    tuner = tune.Tuner(trainable, param_space=common | {"cell": tune.grid_search(cells)})
    failed = [result.error for result in tuner.fit() if result.error]
    if failed:
        raise SystemExit(f"{len(failed)} of {len(cells)} trainings failed; the first: {failed[0]}")
    print(f"{len(cells)} policies in {folder}")


if __name__ == "__main__":
    main()
