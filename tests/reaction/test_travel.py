"""Truth: paths that go at known speeds."""

import numpy as np
import pytest

from pacmo_core.reaction.contacts import no_contacts
from pacmo_core.reaction.finish import Learnt, finish
from pacmo_core.reaction.heights import no_change
from pacmo_core.reaction.travel import NO_LIMIT, peak_speed, slow_down
from tests.reaction.test_floor import LEG, NTU25, standing

FPS = 30.0


def path(burst: float, seconds: float = 0.2, fps: float = FPS) -> np.ndarray:
    """Stand for 1.5 s, go ``burst`` metres ahead in some time, and stand for 1.5 s."""
    times = np.arange(round((3 + seconds) * fps)) / fps
    share = ((times - 1.5) / seconds).clip(0, 1)
    ahead = burst * share**2 * (3 - 2 * share)
    return np.stack([0.3 * ahead, np.sin(times) / 9, ahead], axis=1)


def test_the_speed_is_that_over_the_floor() -> None:
    times = np.arange(60) / FPS
    walks = np.stack([0.6 * times, np.sin(9 * times), 0.8 * times], axis=1)
    assert peak_speed(walks, FPS) == pytest.approx(1.0, abs=1e-6)
    assert peak_speed(walks[:1], FPS) == 0


@pytest.mark.parametrize(("burst", "limit"), [(0.3, 1.0), (0.6, 1.0), (0.6, 1.4), (1.2, 1.4)])
def test_a_burst_takes_more_time_and_ends_where_it_did(burst: float, limit: float) -> None:
    given = path(burst)
    assert peak_speed(given, FPS) > limit
    found = given + slow_down(given, FPS, limit)
    assert peak_speed(found, FPS) < 1.05 * limit
    np.testing.assert_array_equal(found[:, 1], given[:, 1])
    np.testing.assert_allclose(found[[0, -1]], given[[0, -1]], atol=1e-3)
    # It goes the same way, and not back.
    assert (np.diff(found[:, 2]) > -1e-9).all()
    np.testing.assert_allclose(found[:, 0], 0.3 * found[:, 2], atol=1e-6)


def test_a_slow_path_is_unchanged_and_so_is_a_fast_one_without_time() -> None:
    slow = path(0.6, seconds=1.0)
    np.testing.assert_array_equal(slow_down(slow, FPS, 1.4), np.zeros(slow.shape))
    runs = np.stack([np.zeros(20), np.zeros(20), 3 * np.arange(20) / FPS], axis=1)
    found = runs + slow_down(runs, FPS, 1.4)
    np.testing.assert_allclose(found[[0, -1]], runs[[0, -1]], atol=0.1)
    assert len(slow_down(runs[:1], FPS, 1.4)) == 1


def test_it_hardly_depends_on_the_frame_rate() -> None:
    slow, fast = (p + slow_down(p, f, 1.4) for f in (30.0, 120.0) for p in [path(0.8, fps=f)])
    assert np.linalg.norm(fast[::4][: len(slow)] - slow, axis=-1).max() < 0.05


def test_the_finish_moves_the_body_as_a_whole() -> None:
    ahead = path(0.8)
    given = np.tile(standing(LEG)[:1], (len(ahead), 1, 1))
    given[..., 2] += ahead[:, 2:]
    partner = np.tile(standing(LEG, (0.0, 3.0))[:1], (len(ahead), 1, 1))
    root = [
        finish(given, partner, np.arange(len(ahead)) / FPS, NTU25, learnt)[:, NTU25.root]
        for limit in (NO_LIMIT, 1.1)
        for learnt in [Learnt(no_contacts(NTU25), no_change(), np.array([limit]))]
    ]
    assert peak_speed(root[0], FPS) > 1.4 > 1.3 > peak_speed(root[1], FPS)
