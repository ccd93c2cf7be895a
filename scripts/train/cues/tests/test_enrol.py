import numpy as np

import enrol
import network
from golden import lcg
from words import LABELS


def test_a_rehearsal_set_is_read_as_it_was_written(tmp_path) -> None:
    flat = np.maximum(lcg(50 * network.FLAT).reshape(50, -1), 0).astype(np.float32)
    path = tmp_path / "rehearsal.bin"
    enrol.write_rehearsal(path, enrol.Rehearsal(flat, np.arange(50) % 5))
    read = enrol.read_rehearsal(path)
    assert np.array_equal(read.labels, np.arange(50) % 5)
    assert np.abs(read.flat - flat).max() < 1 / 255


def test_enrolment_learns_the_user_and_keeps_the_rest() -> None:
    rng = np.random.default_rng(0)
    weights = network.initial(rng, np.zeros(96), np.ones(96))
    centres = rng.random((2, len(LABELS), network.FLAT)).astype(np.float32)
    near = lambda which, labels: (
        centres[which][labels] + 0.1 * rng.random((len(labels), network.FLAT)).astype(np.float32)
    )
    labels = np.arange(500) % len(LABELS)
    cues = np.arange(100) % 4
    rehearsal = enrol.Rehearsal(near(0, labels), labels)
    adam, known = network.Adam(weights, network.DENSE), np.eye(len(LABELS), dtype=np.float32)[labels]
    for _ in range(100):
        adam.update(network.dense_gradients(weights, rehearsal.flat, known, np.ones(500, np.float32))[0], 3e-3)
    enrolled = enrol.enrol(weights, (near(1, cues), cues), rehearsal, enrol.Recipe(), rng)
    assert (network.classified(enrolled, near(1, cues))[1].argmax(axis=1) == cues).mean() > 0.98
    assert (network.classified(enrolled, near(0, labels))[1].argmax(axis=1) == labels).mean() > 0.98
    assert all(np.array_equal(enrolled[n], weights[n]) for n in weights if n not in network.DENSE)
