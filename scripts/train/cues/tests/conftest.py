import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1]))

import evaluate  # noqa: E402
import features  # noqa: E402
from ship import FOLDS_PATH, SHIPPED  # noqa: E402


@pytest.fixture(scope="session")
def shipped() -> evaluate.Network:
    return evaluate.read(FOLDS_PATH / f"fold-{SHIPPED}.npz")


@pytest.fixture(scope="session")
def embedding(shipped: evaluate.Network) -> features.Embedding:
    return features.Embedding(shipped.embedding)
