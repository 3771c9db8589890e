"""Truth: which numbers make a training possible at all."""

from dataclasses import replace

import pytest

from tests.reaction.problems import PACMO


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("n_points", 1, "n_points must be at least 2; got 1"),
        ("validation_samples", 1, "validation_samples must be at least 2; got 1"),
        ("energy_score_weight", -1.0, "energy_score_weight must be at least 0; got -1.0"),
        ("gradient_penalty_weight", -2.0, "gradient_penalty_weight must be at least 0; got -2.0"),
        ("ema_decay", 1.0, "ema_decay must be at least 0 and less than 1; got 1.0"),
    ],
)
def test_numbers_that_make_no_training_are_refused(name: str, value: float, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        replace(PACMO, **{name: value})
