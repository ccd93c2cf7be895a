import numpy as np

import network
import rehearsal
from golden import lcg


def test_a_rehearsal_set_is_read_as_it_was_written(tmp_path) -> None:
    flat = np.maximum(lcg(50 * network.FLAT).reshape(50, -1), 0).astype(np.float32)
    path = tmp_path / "rehearsal.bin"
    rehearsal.write(path, rehearsal.Rehearsal(flat, np.arange(50) % 6))
    read = rehearsal.read(path)
    assert np.array_equal(read.labels, np.arange(50) % 6)
    assert np.abs(read.flat - flat).max() < 1 / 255
