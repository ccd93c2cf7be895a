import numpy as np

import learning
import network
from augment import SHIFTS, STEPS
from features import EMBEDDING
from words import LABELS


def pool(rng: np.random.Generator) -> learning.Pool:
    """Labels that are written into the embeddings."""
    labels = np.arange(100) % len(LABELS)
    sequences = 0.5 * rng.standard_normal((100, STEPS, EMBEDDING))
    sequences[np.arange(100), :, labels] += 2
    return learning.Pool(sequences.astype(np.float16), labels.astype(np.int8), np.full(100, 0.01))


def test_a_head_learns_the_labels_and_another_from_it() -> None:
    rng = np.random.default_rng(0)
    data, recipe = pool(rng), learning.Recipe(steps=400, batch=64, average=0.9)
    teacher = learning.fit(data, 0, recipe)
    made = learning.judged(teacher, data)
    assert made.shape == (100, SHIFTS, len(LABELS))
    assert (made.argmax(axis=2) == data.labels[:, None]).mean() > 0.98
    turned = np.roll(made, 1, axis=2)
    pupil = learning.fit(data, 1, recipe, taught=turned)
    assert (learning.judged(pupil, data).argmax(axis=2) == turned.argmax(axis=2)).mean() > 0.98
    assert all(pupil[name].shape == shape for name, shape in network.SHAPES.items())
