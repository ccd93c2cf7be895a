"""Soft shielding in the network's probabilities (needs torch)."""

import pytest

torch = pytest.importorskip("torch")

from shielded import STOP, suppressed  # noqa: E402


def probabilities(logits, unsafe, beta):
    return torch.softmax(suppressed(torch.tensor([logits]).log(), torch.tensor([unsafe]), beta), dim=-1)[0]


def test_beta_weighs_what_is_forbidden_and_normalises():
    weighed = probabilities([0.2, 0.5, 0.3], [0, 1, 0], 0.5)
    assert torch.allclose(weighed, torch.tensor([0.2, 0.25, 0.3]) / 0.75)


def test_beta_one_is_no_shield_and_beta_nought_never_takes_it():
    assert torch.allclose(probabilities([0.2, 0.5, 0.3], [0, 1, 0], 1.0), torch.tensor([0.2, 0.5, 0.3]))
    assert torch.allclose(probabilities([0.2, 0.5, 0.3], [0, 1, 0], 0.0), torch.tensor([0.4, 0.0, 0.6]))


def test_where_all_is_forbidden_stop_is_left_or_what_there_was():
    assert probabilities([0.2, 0.5, 0.3], [1, 1, 1], 0.0)[STOP] == 1.0
    assert torch.allclose(probabilities([0.2, 0.5, 0.3], [1, 1, 1], 0.5), torch.tensor([0.2, 0.5, 0.3]))
