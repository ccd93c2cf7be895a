"""Fits the whole network, embedding and heads, to the training windows, end to end, in torch.

The embedding starts as Google's (`features.Embedding`) and is changed like everything else. Two heads look at eight
successive embeddings: one for all labels, one for *stop* alone. For each fold of speakers there is a network that has
not heard it.

    .venv/bin/python mels.py                     # the windows
    .venv/bin/python tune.py --out folds         # five networks: minutes each on a GPU, hours on a CPU
    .venv/bin/python tune.py --out folds --judge # the table: each clip by the network that has not heard its speaker
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import defaultdict
from pathlib import Path

import numpy as np
import torch
from torch import nn

import evaluate
import features
import mels
import strangers
from augment import SHIFTS
from features import BANDS, EMBEDDING, EMBEDDING_PATH, FRAMES, STEP_FRAMES, WINDOWS
from sounds import SPEAKER_FOLD, Recording
from synthesise import seed_of
from windows import OTHER
from words import CUES, LABELS

# What the rates of the head and of the embedding begin with.
HEAD_RATE, TRUNK_RATE = 2e-3, 5e-4
FOLDS_PATH = Path(__file__).parent / "folds"

STOP = LABELS.index("stop")
# Frames that eight embeddings see.
SEEN = FRAMES + (WINDOWS - 1) * STEP_FRAMES


class Trunk(nn.Module):
    """The embedding: log-mel [n, 1, frames, 32] to [n, steps, 96], a step each 8 frames from the 76th on."""

    def __init__(self, path: Path = EMBEDDING_PATH) -> None:
        super().__init__()
        import onnx

        model = onnx.load(path)
        weights = {w.name: onnx.numpy_helper.to_array(w) for w in model.graph.initializer}
        layers: list[nn.Module] = []
        for node in model.graph.node:
            attributes = {a.name: onnx.helper.get_attribute_value(a) for a in node.attribute}
            if node.op_type == "Conv":
                weight = torch.tensor(weights[node.input[1]].copy())
                pads = attributes.get("pads", [0, 0, 0, 0])
                layer = nn.Conv2d(
                    weight.shape[1], weight.shape[0], tuple(weight.shape[2:]), padding=tuple(pads[:2]),
                    bias=len(node.input) > 2,
                )  # fmt: skip
                layer.weight.data = weight
                if len(node.input) > 2:
                    layer.bias.data = torch.tensor(weights[node.input[2]].copy())
                layers.append(layer)
            elif node.op_type == "LeakyRelu":
                # What follows takes the greater of this and a number.
                layers.append(nn.LeakyReLU(attributes["alpha"]))
            elif node.op_type == "Max":
                layers.append(AtLeast(float(weights[node.input[1]].item())))
            elif node.op_type == "MaxPool":
                layers.append(nn.MaxPool2d(tuple(attributes["kernel_shape"]), tuple(attributes["strides"])))
            else:
                assert node.op_type == "Reshape"
        self.layers = nn.Sequential(*layers)

    def forward(self, mel: torch.Tensor) -> torch.Tensor:
        return self.layers(mel)[..., 0].transpose(1, 2)


class AtLeast(nn.Module):
    def __init__(self, least: float) -> None:
        super().__init__()
        self.least = least

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return torch.clamp(x, min=self.least)


class Head(nn.Module):
    """Eight embeddings [n, 8, 96] to logits; see `network`."""

    def __init__(self, labels: int, channels: int = 64, hidden: int = 64, dropout: float = 0.3) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.Conv1d(EMBEDDING, channels, 3), nn.ReLU(), nn.Conv1d(channels, channels, 3), nn.ReLU(), nn.Flatten(),
            nn.Dropout(dropout), nn.Linear(channels * (WINDOWS - 4), hidden), nn.ReLU(), nn.Linear(hidden, labels),
        )  # fmt: skip

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return self.layers(x.transpose(1, 2))


class Ears(nn.Module):
    """Log-mel [n, 1, 132, 32] to logits of all labels [n, 5] and of other and stop [n, 2]."""

    def __init__(self) -> None:
        super().__init__()
        self.trunk = Trunk()
        self.register_buffer("mean", torch.zeros(EMBEDDING))
        self.register_buffer("deviation", torch.ones(EMBEDDING))
        self.cues, self.stop = Head(len(LABELS)), Head(2)

    def normalised(self, mel: torch.Tensor) -> torch.Tensor:
        return torch.clamp((self.trunk(mel) - self.mean) / self.deviation, -6, 6)

    def forward(self, mel: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        seen = self.normalised(mel)
        return self.cues(seen), self.stop(seen)


class Pool:
    """All sequences on the device, and how often each is drawn."""

    def __init__(self, device: str) -> None:
        names, parts = zip(*mels.groups())
        self.sequences = torch.cat([torch.from_numpy(part.sequences).to(device) for part in parts])
        labels = np.concatenate([part.labels for part in parts]).astype(np.int64)
        self.labels = torch.from_numpy(labels).to(device)
        self.folds = np.concatenate([part.folds for part in parts])
        self.group = np.concatenate([np.full(len(part.labels), name) for name, part in zip(names, parts)])

    def chances(self, kept_back: set[int]) -> np.ndarray:
        """Within a group each label is drawn as often. What is kept back is not drawn."""
        labels, usable = self.labels.cpu().numpy(), ~np.isin(self.folds, sorted(kept_back))
        chances = np.zeros(len(labels))
        for name in np.unique(self.group):
            of_group = usable & (self.group == name)
            counts = np.bincount(labels[of_group], minlength=len(LABELS))
            chances[of_group] = mels.share_of(name) / counts[labels[of_group]] / np.count_nonzero(counts)
        return chances / chances.sum()

    def windows(self, at: torch.Tensor, shift: torch.Tensor) -> torch.Tensor:
        """[n, 1, 132, 32] that end `shift` frames later."""
        frames = shift[:, None] + torch.arange(SEEN, device=at.device)
        return self.sequences[at[:, None], frames].float()[:, None]


def masked(mel: torch.Tensor, generator: torch.Generator) -> torch.Tensor:
    """SpecAugment (Park et al. 2019), mild, and another level."""
    n, device = len(mel), mel.device
    uniform = lambda *shape: torch.rand(*shape, generator=generator, device=device)
    mel = mel + 0.5 * (uniform(n, 1, 1, 1) - 0.5) + 0.1 * torch.randn(mel.shape, generator=generator, device=device)
    for size, most, dim in ((BANDS, 5, 3), (SEEN, 10, 2)):
        width = uniform(n) * most * (uniform(n) < 0.5)
        first = uniform(n) * (size - width)
        at = torch.arange(size, device=device)[None]
        hidden = (at >= first[:, None]) & (at < (first + width)[:, None])
        shape = (n, 1, 1, size) if dim == 3 else (n, 1, size, 1)
        mel = torch.where(hidden.view(shape), mel.mean(dim=(2, 3), keepdim=True), mel)
    return mel


def fit(
    data: Pool, kept_back: set[int], seed: int, steps: int, batch: int, trunk_rate: float, budget_s: float
) -> Ears:
    device = data.sequences.device
    torch.manual_seed(seed)
    generator = torch.Generator(device=device).manual_seed(seed)
    chances = data.chances(kept_back)
    weigh = lambda chance: torch.from_numpy(chance.astype(np.float64)).to(device)
    base = drawn = weigh(chances)
    ears = Ears().to(device)
    with torch.no_grad():
        at = torch.multinomial(base, 2048, replacement=True, generator=generator)
        seen = ears.trunk(data.windows(at, torch.zeros_like(at))).reshape(-1, EMBEDDING)
        ears.mean.copy_(seen.mean(dim=0))
        ears.deviation.copy_(seen.std(dim=0) + 1e-3)
    heads = [p for head in (ears.cues, ears.stop) for p in head.parameters()]
    optimiser = torch.optim.AdamW(
        [{"params": ears.trunk.parameters(), "lr": trunk_rate}, {"params": heads, "lr": HEAD_RATE}], weight_decay=0.02
    )
    began = time.monotonic()
    progress = lambda step: min(1.0, max(step / steps, (time.monotonic() - began) / budget_s))
    schedule = torch.optim.lr_scheduler.LambdaLR(
        optimiser, lambda step: min(1, (step + 1) / 200) * (0.02 + 0.98 * 0.5 * (1 + np.cos(np.pi * progress(step))))
    )
    mean = torch.optim.swa_utils.AveragedModel(ears, multi_avg_fn=torch.optim.swa_utils.get_ema_multi_avg_fn(0.999))
    loss_of = nn.CrossEntropyLoss(label_smoothing=0.05)
    ears.train()
    next_look = 1 / 6
    for step in range(steps):
        if progress(step) >= 1:
            break
        if progress(step) >= next_look:
            drawn, next_look = mined(mean.module, data, base), next_look + 1 / 6
        at = torch.multinomial(drawn, batch, replacement=True, generator=generator)
        shift = torch.randint(0, (SHIFTS - 1) * STEP_FRAMES + 1, (batch,), device=device, generator=generator)
        mel, labels = masked(data.windows(at, shift), generator), data.labels[at]
        with torch.autocast(device.type, torch.bfloat16, enabled=device.type == "cuda"):
            cues, stop = ears(mel)
        loss = loss_of(cues.float(), labels) + loss_of(stop.float(), (labels == STOP).long())
        optimiser.zero_grad(set_to_none=True)
        loss.backward()
        nn.utils.clip_grad_norm_(ears.parameters(), 5.0)
        optimiser.step()
        schedule.step()
        mean.update_parameters(ears)
        if step % 500 == 0:
            lately = f"step {step}, loss {float(loss.detach()):.3f}, {time.monotonic() - began:.0f} s"
            print(f"without {sorted(kept_back)}: {lately}", file=sys.stderr, flush=True)
    return mean.module.eval()


@torch.no_grad()
def mined(ears: Ears, data: Pool, base: torch.Tensor, boost: float = 8.0) -> torch.Tensor:
    """Chances after a look at what is wrong: hard sequences are drawn up to 1 + boost times as often."""
    ears.eval()
    wrong = torch.zeros(len(data.labels), device=base.device)
    for at in torch.arange(len(wrong), device=base.device).split(4096):
        shift = torch.randint(0, (SHIFTS - 1) * STEP_FRAMES + 1, (len(at),), device=base.device)
        cues = ears(data.windows(at, shift))[0].float().softmax(dim=1)
        wrong[at] = 1 - cues[torch.arange(len(at), device=base.device), data.labels[at]]
    chances = base * (1 + boost * wrong)
    for cue in (True, False):
        of_kind = (data.labels != OTHER) == cue
        chances[of_kind] *= base[of_kind].sum() / chances[of_kind].sum()
    return chances / chances.sum()


@torch.no_grad()
def heard(ears: Ears, mel: np.ndarray) -> np.ndarray:
    """float32[steps, 7] of log-mel float32[frames, 32]: probabilities of all labels, and of other and stop."""
    device = next(ears.parameters()).device
    seen = ears.normalised(torch.from_numpy(mel)[None, None].to(device))[0]
    if len(seen) < WINDOWS:
        return np.zeros((0, len(LABELS) + 2), np.float32)
    windows = seen.unfold(0, WINDOWS, 1).transpose(1, 2)
    both = [head(windows).softmax(dim=1) for head in (ears.cues, ears.stop)]
    return torch.cat(both, dim=1).cpu().numpy()


# --- Files


def save(path: Path, ears: Ears) -> None:
    """Half precision: a network's probabilities change by less than a thousandth."""
    numbers = {name: value.detach().cpu().numpy().astype(np.float16) for name, value in ears.state_dict().items()}
    np.savez_compressed(path, **numbers)


def load(path: Path, device: str = "cpu") -> Ears:
    ears = Ears()
    with np.load(path) as file:
        ears.load_state_dict({name: torch.from_numpy(file[name].astype(np.float32)) for name in file.files})
    return ears.to(device).eval()


def path_of(out: Path, fold: int) -> Path:
    return out / f"fold-{fold}.npz"


# --- Judging

PHASES = STEP_FRAMES
THRESHOLDS = (0.5, 0.6, 0.7, 0.8, 0.9)


def mel_of(recording: Recording) -> np.ndarray:
    """As `evaluate.streams` has it, clean."""
    rng = np.random.default_rng(seed_of("evaluate", "clean", recording.name))
    noise = 10 ** (-70 / 20) * rng.standard_normal(len(recording.audio) + 2 * evaluate.SILENCE)
    return features.log_mel((np.pad(recording.audio, evaluate.SILENCE) + noise).astype(np.float32))


def surest(probabilities: np.ndarray, column: int, windows: int) -> float:
    """The greatest probability that so many successive windows have."""
    of = probabilities[:, column]
    if len(of) < windows:
        return 0.0
    return float(np.lib.stride_tricks.sliding_window_view(of, windows).min(axis=1).max())


def alarms(probabilities: np.ndarray, column: int, windows: int, threshold: float, rest: int = 12) -> int:
    """How often that many windows reach a threshold. After each, so many steps do not count."""
    of = np.lib.stride_tricks.sliding_window_view(probabilities[:, column], windows).min(axis=1) >= threshold
    count, last = 0, -rest - 1
    for step in np.flatnonzero(of):
        count += step - last > rest
        last = step
    return count


def judge(out: Path, device: str) -> None:
    """Each real clip at every phase of a step, by the network that has not heard its speaker; reading likewise."""
    networks = {fold: load(path_of(out, fold), device) for fold in range(strangers.FOLDS)}
    said: dict[str, list[np.ndarray]] = defaultdict(list)
    for recording in strangers.words():
        mel = mel_of(recording)
        said[recording.word] += [heard(networks[recording.fold], mel[phase:]) for phase in range(PHASES)]
    read = [heard(networks[r.fold], mel_of(r)) for r in strangers.reading()]
    hours = sum(len(r.audio) for r in strangers.reading()) / features.RATE / 3600
    print("recall and false accepts: means over all phases; false alarms an hour of reading")
    for name, column, windows in (("stop, its own head", 6, 1), *((cue, LABELS.index(cue), 2) for cue in CUES)):
        word = name.split(",")[0]
        right = np.array([surest(p, column, windows) for p in said[word]])
        wrong = {w: np.array([surest(p, column, windows) for p in said[w]]) for w in said if w != word}
        print(f"{name}: {len(right) // PHASES} clips, {sum(map(len, wrong.values())) // PHASES} others")
        for threshold in THRESHOLDS:
            accepts = np.concatenate(list(wrong.values())) >= threshold
            often = sorted(((float((p >= threshold).mean()), w) for w, p in wrong.items()), reverse=True)[:3]
            count = sum(alarms(p, column, windows, threshold) for p in read)
            print(
                f"  {threshold}: {np.mean(right >= threshold):.3f}, {accepts.mean():.4f}, {count / hours:.1f};"
                f" most often {', '.join(f'{w} {share:.2f}' for share, w in often)}"
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=5000)
    parser.add_argument("--batch", type=int, default=256)
    parser.add_argument("--folds", type=int, nargs="*", default=list(range(strangers.FOLDS)))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--frozen", action="store_true", help="the embedding stays as it is")
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    parser.add_argument("--budget-s", type=float, default=float("inf"), help="of each network; its rate falls in time")
    parser.add_argument("--out", type=Path, default=FOLDS_PATH)
    parser.add_argument("--judge", action="store_true", help="train nothing, print the table")
    arguments = parser.parse_args()
    if arguments.judge:
        return judge(arguments.out, arguments.device)
    torch.backends.cuda.matmul.allow_tf32 = torch.backends.cudnn.allow_tf32 = True
    arguments.out.mkdir(parents=True, exist_ok=True)
    data = Pool(arguments.device)
    trunk_rate = 0.0 if arguments.frozen else TRUNK_RATE
    for fold in arguments.folds:
        kept_back = {fold, SPEAKER_FOLD}
        ears = fit(data, kept_back, arguments.seed, arguments.steps, arguments.batch, trunk_rate, arguments.budget_s)
        save(path_of(arguments.out, fold), ears)


if __name__ == "__main__":
    main()
