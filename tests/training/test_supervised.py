"""Truth: a permutation of all rows."""

import torch

from pacmo_core.training.supervised import random_batches


def test_batches_hold_every_row_once() -> None:
    cut = random_batches(21, 8, torch.Generator().manual_seed(0))
    assert sorted(torch.cat(cut).tolist()) == list(range(21))
    assert {len(rows) for rows in cut} == {7}
