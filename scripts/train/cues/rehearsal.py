"""Rehearsal: windows of the training data, by which enrolment keeps in mind what the head made of other voices.

Its file, little-endian: the bytes "GDRH", u32 version 2, u32 windows n, u32 features 256, f32 scale; then u8 label[n],
u8 feature[n][256], channel by channel of the second convolution after its relu (index 4 c + t): feature times scale is
the value.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import NamedTuple

import numpy as np

MAGIC, VERSION = b"GDRH", 2


class Rehearsal(NamedTuple):
    flat: np.ndarray  # float32[n, 256]
    labels: np.ndarray  # int64[n]


def write(path: Path, rehearsal: Rehearsal) -> None:
    scale = float(np.quantile(rehearsal.flat.max(axis=1), 0.999)) / 255
    stored = np.clip(np.round(rehearsal.flat / scale), 0, 255).astype(np.uint8)
    n, width = stored.shape
    header = MAGIC + struct.pack("<IIIf", VERSION, n, width, scale)
    path.write_bytes(header + rehearsal.labels.astype(np.uint8).tobytes() + stored.tobytes())


def read(path: Path) -> Rehearsal:
    data = path.read_bytes()
    version, n, width, scale = struct.unpack_from("<IIIf", data, 4)
    if data[:4] != MAGIC or version != VERSION or len(data) != 20 + n * (1 + width):
        raise ValueError(f"{path} is no rehearsal set of version {VERSION}")
    labels = np.frombuffer(data, np.uint8, n, 20).astype(np.int64)
    return Rehearsal(np.frombuffer(data, np.uint8, n * width, 20 + n).reshape(n, width) * np.float32(scale), labels)
