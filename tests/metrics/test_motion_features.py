"""Oracle: repeated training, and features of other weights."""

import numpy as np
import pytest
import torch

from pacmo_core.metrics.motion_features import (
    FeatureExtractorSettings,
    build_extractor_training,
    fingerprint,
)
from tests.skeleton_prior.examples import SMALL, interaction

SETTINGS = FeatureExtractorSettings(
    random_seed=1,
    hidden=16,
    n_features=4,
    n_frames=12,
    n_decoded_frames=3,
    learning_rate=3e-3,
    halve_learning_rate_every=100,
    batch_size=4,
    n_epochs=2,
)


def test_features_are_reproducible_and_identified_by_their_fingerprint():
    motions = [interaction(seed).person_a for seed in range(4)]
    one, again = (build_extractor_training(motions, SMALL, SETTINGS).finish() for _ in range(2))
    assert fingerprint(one) == fingerprint(again)
    result = one.features(motions)
    assert result.shape == (4, 4) and result.dtype == np.float64
    np.testing.assert_array_equal(result, again.features(motions))
    np.testing.assert_allclose(one.features(motions[1:2])[0], result[1], atol=1e-6)
    assert one.features([motions[0][:20]]).shape == (1, 4)  # motions of other lengths too
    with torch.no_grad():
        next(again.parameters())[0] += 1e-3
    assert fingerprint(one) != fingerprint(again)


@pytest.mark.slow
def test_training_lowers_the_reconstruction_error():
    motions = [interaction(seed).person_a for seed in range(6)]
    loop = build_extractor_training(
        motions, SMALL, FeatureExtractorSettings(**{**vars(SETTINGS), "n_epochs": 40})
    )
    loop.finish()
    assert loop.curve[-1]["loss"] < 0.5 * loop.curve[0]["loss"]
