"""Truth: motions of known accelerations."""

import numpy as np
import pytest

from pacmo_core.finish.twitches import damp_twitches, peak_accelerations


def swing(fps: float) -> np.ndarray:
    """Swing one joint of two by 0.5 m, once a second; the largest acceleration is 19.7 m/s²."""
    times = np.arange(round(4 * fps)) / fps
    motion = np.zeros((len(times), 2, 3))
    motion[:, 1, 0] = 0.5 * np.sin(2 * np.pi * times)
    return motion


@pytest.mark.parametrize("fps", [30.0, 60.0, 120.0])
def test_the_acceleration_of_a_swing_is_that_of_its_sine(fps: float) -> None:
    found = peak_accelerations(swing(fps), fps)
    np.testing.assert_allclose(found, [0, 0.5 * (2 * np.pi) ** 2], rtol=0.01)


@pytest.mark.parametrize("fps", [30.0, 60.0])
def test_a_twitch_is_damped_and_the_motion_around_it_stays(fps: float) -> None:
    given = swing(fps)
    limits = 1.5 * peak_accelerations(given, fps) + 5
    assert damp_twitches(given, fps, limits) is given
    middle = len(given) // 2
    twitch = given.copy()
    twitch[middle : middle + round(fps / 15), 1] += [0, 0.16, 0]
    assert peak_accelerations(twitch, fps)[1] > 3 * limits[1]
    found = damp_twitches(twitch, fps, limits)
    assert (peak_accelerations(found, fps) < 1.05 * limits).all()
    assert np.abs(found[:, 0]).max() == 0
    far = np.abs(np.arange(len(given)) - middle) > 0.5 * fps
    np.testing.assert_allclose(found[far], given[far], atol=1e-3)
    assert np.linalg.norm(found - given, axis=-1).max() < 0.1
