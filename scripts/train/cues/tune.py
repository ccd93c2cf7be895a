"""Fits the whole network, embedding and head, to the training windows, end to end, in torch.

The embedding starts as Google's and is changed like everything else; the head looks at eight successive embeddings.
For each fold of speakers there is a network that has not heard it.

    .venv/bin/python mels.py          # the windows
    .venv/bin/python tune.py          # five networks: minutes each on a GPU, hours on a CPU
    .venv/bin/python tune.py --heads  # new heads on the embeddings that are there: half an hour on a CPU
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np
import torch
from torch import nn

import features
import mels
import strangers
import trunk
from augment import SHIFTS, STEPS
from features import BANDS, EMBEDDING, FRAMES, STEP_FRAMES, WINDOWS
from synthesise import BUILD
from windows import OTHER
from words import LABELS

# What the rates of the head and of the embedding begin with.
HEAD_RATE, TRUNK_RATE = 2e-3, 5e-4
FOLDS_PATH = Path(__file__).parent / "folds"
# Fetched by `setup`.
GOOGLES = BUILD / "google/embedding.onnx"

# Frames that eight embeddings see.
SEEN = FRAMES + (WINDOWS - 1) * STEP_FRAMES


class Trunk(nn.Module):
    """The embedding: log-mel [n, 1, frames, 32] to [n, steps, 96], a step each 8 frames from the 76th on."""

    def __init__(self) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        channels = 1
        for layer in trunk.LAYERS:
            if isinstance(layer, trunk.Pool):
                layers.append(nn.MaxPool2d((layer.time, layer.bands)))
                continue
            size, sides = (layer.time, layer.bands), (0, layer.bands // 2)
            layers.append(nn.Conv2d(channels, layer.channels, size, padding=sides, bias=not layer.last))
            if not layer.last:
                layers += [nn.LeakyReLU(trunk.SLOPE), AtLeast(trunk.LEAST)]
            channels = layer.channels
        self.layers = nn.Sequential(*layers)

    def begin_as(self, path: Path) -> None:
        """With the weights of Google's file, which has them in the same order."""
        import onnx

        model = onnx.load(path)
        stored = {w.name: onnx.numpy_helper.to_array(w) for w in model.graph.initializer}
        convolutions = [node for node in model.graph.node if node.op_type == "Conv"]
        for layer, node in zip((x for x in self.layers if isinstance(x, nn.Conv2d)), convolutions, strict=True):
            for parameter, name in zip((layer.weight, layer.bias), node.input[1:]):
                parameter.data = torch.tensor(stored[name].copy())

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
    """Log-mel [n, 1, 132, 32] to logits of all labels [n, 6]."""

    def __init__(self) -> None:
        super().__init__()
        self.trunk = Trunk()
        self.register_buffer("mean", torch.zeros(EMBEDDING))
        self.register_buffer("deviation", torch.ones(EMBEDDING))
        self.head = Head(len(LABELS))

    def normalised(self, embeddings: torch.Tensor) -> torch.Tensor:
        return torch.clamp((embeddings - self.mean) / self.deviation, -6, 6)

    def forward(self, mel: torch.Tensor) -> torch.Tensor:
        return self.head(self.normalised(self.trunk(mel)))


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
        """Within a group each label is drawn as often, but for those of few sequences. What is kept back is not drawn."""
        labels, usable = self.labels.cpu().numpy(), ~np.isin(self.folds, sorted(kept_back))
        chances = np.zeros(len(labels))
        for name in np.unique(self.group):
            of_group = usable & (self.group == name)
            counts = np.bincount(labels[of_group], minlength=len(LABELS))
            often = np.minimum(1, 20 * counts / counts.max()) / np.maximum(counts, 1)
            chances[of_group] = mels.share_of(name) * often[labels[of_group]] / often[labels[of_group]].sum()
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
    ears.trunk.begin_as(GOOGLES)
    with torch.no_grad():
        at = torch.multinomial(base, 2048, replacement=True, generator=generator)
        seen = ears.trunk(data.windows(at, torch.zeros_like(at))).reshape(-1, EMBEDDING)
        ears.mean.copy_(seen.mean(dim=0))
        ears.deviation.copy_(seen.std(dim=0) + 1e-3)
    optimiser = torch.optim.AdamW(
        [
            {"params": ears.trunk.parameters(), "lr": trunk_rate},
            {"params": ears.head.parameters(), "lr": HEAD_RATE},
        ],
        weight_decay=0.02,
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
            loss = loss_of(ears(mel).float(), labels)
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
def mined(ears: Ears, data: Pool, base: torch.Tensor) -> torch.Tensor:
    """Chances after a look at what is wrong: see `boosted`."""
    ears.eval()
    wrong = torch.zeros(len(data.labels), device=base.device)
    for at in torch.arange(len(wrong), device=base.device).split(4096):
        shift = torch.randint(0, (SHIFTS - 1) * STEP_FRAMES + 1, (len(at),), device=base.device)
        cues = ears(data.windows(at, shift)).float().softmax(dim=1)
        wrong[at] = 1 - cues[torch.arange(len(at), device=base.device), data.labels[at]]
    return boosted(wrong, data.labels, base)


def boosted(wrong: torch.Tensor, labels: torch.Tensor, base: torch.Tensor, boost: float = 8.0) -> torch.Tensor:
    """What is wrong by much is drawn more often; cues and all else together as often as before."""
    chances = base * (1 + boost * wrong)
    for cue in (True, False):
        of_kind = (labels != OTHER) == cue
        chances[of_kind] *= base[of_kind].sum() / chances[of_kind].sum()
    return chances / chances.sum()


# --- Heads alone


def trunk_weights(ears: Ears) -> trunk.Weights:
    return {name: value.cpu().numpy() for name, value in ears.trunk.state_dict().items()}


def embedded(ears: Ears, data: Pool, at: np.ndarray) -> torch.Tensor:
    """What its embedding makes of sequences: normalised, half precision [n, 13, 96]. ONNX Runtime is faster here."""
    embedding = features.Embedding(trunk.whole(trunk_weights(ears)).SerializeToString())
    made = torch.empty(len(at), STEPS, EMBEDDING, dtype=torch.half)
    for start in range(0, len(at), 64):
        mel = data.sequences[at[start : start + 64]].float().numpy()
        made[start : start + 64] = ears.normalised(torch.from_numpy(embedding.of_mel(mel))).half()
    return made


def refit(ears: Ears, data: Pool, kept_back: set[int], seed: int, steps: int, batch: int, most: int) -> Ears:
    """A new head on an embedding that stays: by at most so many sequences, whose windows begin with a step each."""
    torch.manual_seed(seed)
    dice, chances = np.random.default_rng(seed), data.chances(kept_back)
    at = np.sort(dice.choice(len(chances), min(most, np.count_nonzero(chances)), replace=False, p=chances))
    seen, labels = embedded(ears, data, at), data.labels[torch.from_numpy(at)]
    # What is left has its group's and label's whole part.
    base = torch.from_numpy(spread(chances, data, at))
    ears.head, drawn = Head(len(LABELS)), base
    optimiser = torch.optim.AdamW(ears.head.parameters(), lr=HEAD_RATE, weight_decay=0.02)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, steps, HEAD_RATE * 0.02)
    average = torch.optim.swa_utils.get_ema_multi_avg_fn(0.999)
    mean = torch.optim.swa_utils.AveragedModel(ears.head, multi_avg_fn=average)
    loss_of = nn.CrossEntropyLoss(label_smoothing=0.05)
    ears.head.train()
    for step in range(steps):
        if step and step % (steps // 6) == 0:
            drawn = mined_again(mean.module, seen, labels, base)
        chosen = torch.multinomial(drawn, batch, replacement=True)
        shift = torch.randint(0, SHIFTS, (batch,))
        windows = seen[chosen[:, None], shift[:, None] + torch.arange(WINDOWS)].float()
        loss = loss_of(ears.head(windows + 0.1 * torch.randn(windows.shape)), labels[chosen])
        optimiser.zero_grad(set_to_none=True)
        loss.backward()
        optimiser.step()
        schedule.step()
        mean.update_parameters(ears.head)
    ears.head = mean.module
    lately = f"{len(at)} sequences, loss {float(loss.detach()):.3f}"
    print(f"without {sorted(kept_back)}: {lately}", file=sys.stderr, flush=True)
    return ears.eval()


def spread(chances: np.ndarray, data: Pool, at: np.ndarray) -> np.ndarray:
    """Chances of some sequences, where each group and label is drawn as often as of all."""
    labels = data.labels.numpy()
    kind = np.array([f"{group} {label}" for group, label in zip(data.group, labels)])
    names, number = np.unique(kind, return_inverse=True)
    whole = np.bincount(number, chances, len(names))
    left = np.bincount(number[at], minlength=len(names))
    made = whole[number[at]] / left[number[at]]
    return made / made.sum()


@torch.no_grad()
def mined_again(head: Head, seen: torch.Tensor, labels: torch.Tensor, base: torch.Tensor) -> torch.Tensor:
    """As `mined`, of embeddings."""
    head.eval()
    parts = torch.arange(len(labels)).split(4096)
    first = [head(seen[part, :WINDOWS].float()).softmax(dim=1)[torch.arange(len(part)), labels[part]] for part in parts]
    return boosted(1 - torch.cat(first), labels, base)


# --- Files


def save(path: Path, ears: Ears) -> None:
    """Half precision: a network's probabilities change by less than a thousandth."""
    numbers = {name: value.detach().cpu().numpy().astype(np.float16) for name, value in ears.state_dict().items()}
    np.savez_compressed(path, **numbers)


def load(path: Path, device: str = "cpu") -> Ears:
    ears = Ears()
    with np.load(path) as file:
        stored = {name: torch.from_numpy(file[name].astype(np.float32)) for name in file.files}
    ears.load_state_dict(stored)
    return ears.to(device).eval()


def path_of(out: Path, fold: int) -> Path:
    return out / f"fold-{fold}.npz"


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
    parser.add_argument("--heads", action="store_true", help="leave the embeddings of --out, fit new heads")
    parser.add_argument("--most", type=int, default=60_000, help="sequences that new heads see")
    arguments = parser.parse_args()
    torch.backends.cuda.matmul.allow_tf32 = torch.backends.cudnn.allow_tf32 = True
    arguments.out.mkdir(parents=True, exist_ok=True)
    data = Pool(arguments.device)
    trunk_rate = 0.0 if arguments.frozen else TRUNK_RATE
    for fold in arguments.folds:
        kept_back = {fold}
        if arguments.heads:
            before = load(path_of(arguments.out, fold))
            ears = refit(before, data, kept_back, arguments.seed, arguments.steps, arguments.batch, arguments.most)
            save(path_of(arguments.out, fold), ears)
            continue
        ears = fit(data, kept_back, arguments.seed, arguments.steps, arguments.batch, trunk_rate, arguments.budget_s)
        save(path_of(arguments.out, fold), ears)


if __name__ == "__main__":
    main()
