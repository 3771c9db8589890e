"""Truth: a reconstruction error that falls, and features that are standardised."""

import numpy as np
import pytest

from pacmo_core.reaction import autoencoder
from pacmo_core.reaction.data import expand_directions
from tests.reaction.problems import AUTOENCODER, clips


@pytest.mark.slow
def test_the_autoencoder_learns_and_its_features_are_standard_on_training_data() -> None:
    fitted = autoencoder.build_training(clips(32), AUTOENCODER, validation=clips(8, first_seed=50))
    terms = list(fitted)
    assert terms[-1]["validation"] < 0.4 * terms[0]["validation"]
    found = autoencoder.encode_features(fitted.model, expand_directions(clips(32), both=True))
    assert found.shape == (64, 4, 5)
    np.testing.assert_allclose(found.mean(axis=(0, 2)), 0, atol=1e-5)
    np.testing.assert_allclose(found.std(axis=(0, 2)), 1, atol=1e-2)
