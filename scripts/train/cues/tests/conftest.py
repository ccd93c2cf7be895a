import os
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1]))

import features  # noqa: E402


@pytest.fixture(scope="session")
def embedding() -> features.Embedding:
    if not features.EMBEDDING_PATH.exists():
        message = f"{features.EMBEDDING_PATH} is missing: run scripts/cue-embedding"
        if os.environ.get("CI") == "true":
            pytest.fail(message)
        pytest.skip(message)
    return features.Embedding()
