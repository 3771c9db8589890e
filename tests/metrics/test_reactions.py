"""Trusted: what a row of reactions is: as many of everything, of one shape, finite."""

from dataclasses import replace

import numpy as np
import pytest

from tests.metrics.problems import reactions


def test_reactions_must_agree_in_number_shape_and_be_finite():
    real = reactions(12, "test", np.random.default_rng(0), further=1)
    with pytest.raises(ValueError, match=r"n > 0 motions"):
        replace(real, clips=real.clips[1:])
    with pytest.raises(ValueError, match="sample 0: wanted motion and partner"):
        replace(real, partners=[real.partners[0][1:], *real.partners[1:]])
    broken = real.motions[3].copy()
    broken[0, 0, 0] = np.nan
    with pytest.raises(ValueError, match="sample 3"):
        replace(real, motions=[*real.motions[:3], broken, *real.motions[4:]])
    features = real.features.copy()
    features[5] = np.inf
    with pytest.raises(ValueError, match="sample 5"):
        replace(real, features=features)
    with pytest.raises(ValueError, match=r"embedded must be \(2, 24, E\)"):
        replace(real, embedded=real.embedded[:1])
    with pytest.raises(ValueError, match=r"must be \(S, 24, 2, 6\)"):
        replace(real, further=real.further[:, 1:])
