"""Truth: an average written out, and losses that are not finite."""

import pytest
import torch

from pacmo_core.operators.spectral import initialise_weights
from pacmo_core.training.state import check_finite, ema_copy, update_ema


def test_the_moving_average_weighs_the_past_exponentially() -> None:
    model = torch.nn.Linear(3, 2)
    initialise_weights(model, torch.Generator().manual_seed(0))
    mean, start = ema_copy(model), model.weight.detach().clone()
    with torch.no_grad():
        model.weight.add_(1)
    for _ in range(3):
        update_ema(mean, model, 0.9)
    torch.testing.assert_close(mean.weight, start + 1 - 0.9**3)
    assert not mean.weight.requires_grad


def test_an_average_may_keep_a_share_of_the_weights_that_a_training_continues_from() -> None:
    model = torch.nn.Linear(3, 2)
    initialise_weights(model, torch.Generator().manual_seed(0))
    mean, start = ema_copy(model), ema_copy(model)
    with torch.no_grad():
        model.weight.add_(1)
    for _ in range(3):
        update_ema(mean, model, 0.9, start, 0.25)
    torch.testing.assert_close(mean.weight, start.weight + 0.75 * (1 - 0.9**3))


def test_a_loss_that_is_not_finite_is_refused_by_name() -> None:
    terms = {"distance": torch.tensor(1.0), "penalty": torch.tensor(float("nan"))}
    with pytest.raises(FloatingPointError, match="penalty not finite"):
        check_finite(terms, "wgan")
