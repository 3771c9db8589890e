"""Truth: paths and turns that go at known speeds."""

from dataclasses import replace

import numpy as np
import pytest

from pacmo_core.finish.finish import finish
from pacmo_core.finish.learnt import nothing_learnt
from pacmo_core.finish.travel import NO_LIMIT, peak_speeds, slow_down, spread_bursts
from pacmo_core.finish.turns import find_headings, turned
from tests.finish.test_floor import LEG, NTU25, standing

FPS = 30.0


def path(burst: float, seconds: float = 0.2, fps: float = FPS) -> np.ndarray:
    """Stand for 1.5 s, go ``burst`` metres ahead in some time, and stand for 1.5 s; (T, 2)."""
    times = np.arange(round((3 + seconds) * fps)) / fps
    share = ((times - 1.5) / seconds).clip(0, 1)
    ahead = burst * share**2 * (3 - 2 * share)
    return np.stack([0.3 * ahead, ahead], axis=1)


def body(places: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Return a body that stands at places ``(T, 2)`` over the floor, turned by ``(T,)`` radians."""
    one = standing(LEG)[:1].astype(np.float64) - standing(LEG)[:1, [NTU25.root]]
    motion = turned(np.repeat(one, len(places), axis=0), angles)
    motion[..., [0, 2]] += places[:, None]
    return motion


def peak_speed(places: np.ndarray, fps: float) -> float:
    return float(peak_speeds(body(places, np.zeros(len(places))), fps, NTU25)[0])


def test_the_speed_is_that_over_the_floor_and_that_of_turns() -> None:
    times = np.arange(60) / FPS
    walks = body(np.stack([0.6 * times, 0.8 * times], axis=1), 0.5 * times)
    walks[..., 1] += np.sin(9 * times)[:, None]
    np.testing.assert_allclose(peak_speeds(walks, FPS, NTU25), [1.0, 0.5], atol=1e-6)
    np.testing.assert_array_equal(peak_speeds(walks[:1], FPS, NTU25), [0, 0])


@pytest.mark.parametrize(("burst", "limit"), [(0.3, 1.0), (0.6, 1.0), (0.6, 1.4), (1.2, 1.4)])
def test_a_burst_takes_more_time_and_ends_where_it_did(burst: float, limit: float) -> None:
    given = path(burst)
    assert peak_speed(given, FPS) > limit
    found = given + slow_down(given, FPS, limit)
    assert peak_speed(found, FPS) < 1.05 * limit
    np.testing.assert_allclose(found[[0, -1]], given[[0, -1]], atol=1e-3)
    # It goes the same way, and not back.
    assert (np.diff(found[:, 1]) > -1e-9).all()
    np.testing.assert_allclose(found[:, 0], 0.3 * found[:, 1], atol=1e-6)


def test_a_slow_path_is_unchanged_and_so_is_a_fast_one_without_time() -> None:
    slow = path(0.6, seconds=1.0)
    np.testing.assert_array_equal(slow_down(slow, FPS, 1.4), np.zeros(slow.shape))
    runs = np.stack([np.zeros(20), 3 * np.arange(20) / FPS], axis=1)
    found = runs + slow_down(runs, FPS, 1.4)
    np.testing.assert_allclose(found[[0, -1]], runs[[0, -1]], atol=0.1)
    assert len(slow_down(runs[:1], FPS, 1.4)) == 1


def test_it_hardly_depends_on_the_frame_rate() -> None:
    slow, fast = (p + slow_down(p, f, 1.4) for f in (30.0, 120.0) for p in [path(0.8, fps=f)])
    assert np.linalg.norm(fast[::4][: len(slow)] - slow, axis=-1).max() < 0.05


def test_a_body_that_spins_takes_more_time_and_turns_as_a_whole() -> None:
    angles = path(2.5)[:, 1]
    given = body(np.zeros((len(angles), 2)), angles)
    found = spread_bursts(given, FPS, NTU25, np.array([NO_LIMIT, 3.5]))
    before, after = (find_headings(motion, None, NTU25) for motion in (given, found))
    assert peak_speeds(given, FPS, NTU25)[1] > 8 > 3.7 > peak_speeds(found, FPS, NTU25)[1]
    np.testing.assert_allclose(after[[0, -1]], before[[0, -1]], atol=0.02)
    np.testing.assert_allclose(found, turned(given, after - before), atol=0.01)
    np.testing.assert_array_equal(
        spread_bursts(given, FPS, NTU25, np.array([NO_LIMIT, NO_LIMIT])), given
    )


def test_the_finish_moves_the_body_as_a_whole() -> None:
    ahead = path(0.8)
    given = np.tile(standing(LEG)[:1], (len(ahead), 1, 1))
    given[..., 2] += ahead[:, 1:]
    partner = np.tile(standing(LEG, (0.0, 3.0))[:1], (len(ahead), 1, 1))
    free, calm = (
        peak_speeds(finish(given, partner, np.arange(len(ahead)) / FPS, NTU25, learnt), FPS, NTU25)[
            0
        ]
        for limit in (NO_LIMIT, 1.1)
        for learnt in [replace(nothing_learnt(NTU25), max_speeds=np.array([limit, NO_LIMIT]))]
    )
    assert free > 1.4 > 1.3 > calm
