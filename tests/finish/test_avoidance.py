"""Truth: paths at known distances from a partner who stands still."""

import numpy as np
import pytest

from pacmo_core.data.skeleton import SBU15
from pacmo_core.finish.avoidance import avoid_partner, trunk_offset
from tests.reaction.problems import REST

FPS = 30.0


def walking(aside: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a partner who stands, and a body that walks by them, this far aside, at 1 m/s."""
    times = np.arange(120) / FPS
    partner = np.repeat(REST[None], len(times), axis=0).astype(np.float32)
    motion = partner.astype(np.float64)
    motion[..., 0] += aside
    motion[..., 2] += (times - 2)[:, None]
    return motion, partner


@pytest.mark.parametrize("aside", [0.02, -0.2])
def test_a_body_that_goes_through_the_partner_goes_round_on_its_side(aside: float) -> None:
    motion, partner = walking(aside)
    found = avoid_partner(motion, partner, FPS, SBU15, 0.35)
    path = trunk_offset(found, partner, SBU15)
    assert np.linalg.norm(path, axis=1).min() > 0.35 - 1e-6
    assert (np.sign(path[:, 0]) == np.sign(aside)).all()
    # It hastens little, moves as a whole, and far from the partner as before.
    speed = np.linalg.norm(np.diff(path, axis=0), axis=1) * FPS
    assert speed.max() < 1.6
    np.testing.assert_allclose(found - motion, (found - motion)[:, :1] * np.ones((15, 1)))
    assert np.abs((found - motion)[..., 1]).max() == 0
    np.testing.assert_allclose(found[[0, -1]], motion[[0, -1]], atol=1e-3)


def test_a_body_that_keeps_the_distance_is_unchanged() -> None:
    motion, partner = walking(0.3)
    assert avoid_partner(motion, partner, FPS, SBU15, 0.35) is motion
    assert avoid_partner(motion, partner, FPS, SBU15, 0.0) is motion
