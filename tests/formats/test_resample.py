"""Truth: polynomials, which a cubic spline repeats; turns written out; the reader's own turn."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pacmo_core.formats.base import to_y_up
from pacmo_core.formats.resample import frame_rate, from_y_up, resample, sample_times, with_missing

TIMES = np.sort(np.random.default_rng(0).uniform(0, 2, 30))


def cubic(times: np.ndarray) -> np.ndarray:
    line = 1 - 2 * times + 0.5 * times**2 + 0.25 * times**3
    return np.stack([line, 2 * line, -line], axis=-1)[:, None]


@settings(derandomize=True, deadline=None, max_examples=30)
@given(st.floats(5, 240))
def test_a_cubic_motion_is_found_at_any_rate(fps: float) -> None:
    at = sample_times(TIMES, fps)
    found = resample(cubic(TIMES).astype(np.float32), TIMES, at)
    np.testing.assert_allclose(found, cubic(at), atol=2e-4)


def test_frames_that_stay_are_the_same() -> None:
    motion = np.random.default_rng(1).normal(size=(31, 4, 3)).astype(np.float32)
    times = np.arange(31) / 30
    at = sample_times(times, 60)
    assert len(at) == 61
    np.testing.assert_allclose(resample(motion, times, at)[::2], motion, atol=1e-6)
    np.testing.assert_allclose(resample(motion, times, times), motion, atol=1e-6)


def test_instants_begin_at_the_first_frame_and_stay_within_the_clip() -> None:
    times = 5 + np.arange(31) / 30
    for fps in (7, 24, 30, 120):
        at = sample_times(times, fps)
        assert at[0] == 5
        assert at[-1] <= times[-1] + 1e-9 < at[-1] + 1 / fps
        np.testing.assert_allclose(np.diff(at), 1 / fps)


def test_two_frames_are_joined_by_a_line() -> None:
    ends = np.array([[[0, 0, 0]], [[1, 2, 3]]], np.float32)
    found = resample(ends, np.array([0.0, 1.0]), np.array([0.25]))
    np.testing.assert_allclose(found, [[[0.25, 0.5, 0.75]]])


@pytest.mark.parametrize("fps", [0.0, -30.0, 1e6])
def test_rates_that_no_capture_has_are_refused(fps: float) -> None:
    with pytest.raises(ValueError, match="fps must be"):
        sample_times(TIMES, fps)


def test_a_clip_too_short_for_two_frames_is_refused() -> None:
    with pytest.raises(ValueError, match="too short"):
        sample_times(np.array([0, 0.1]), 5)


def test_turning_to_z_up_undoes_what_reading_does() -> None:
    motion = np.random.default_rng(2).normal(size=(5, 3, 3)).astype(np.float32)
    for up in ("y", "z"):
        np.testing.assert_array_equal(to_y_up(from_y_up(motion, up), up), motion)
    np.testing.assert_array_equal(from_y_up(np.array([0, 1, 0], np.float32), "z"), [0, 0, 1])
    with pytest.raises(ValueError, match="up must be"):
        from_y_up(motion, "x")


def test_the_frame_rate_is_that_of_most_frames() -> None:
    times = np.delete(np.arange(50) / 25.0, [7, 8, 30])  # frames that a camera lost
    assert frame_rate(times) == pytest.approx(25)


@pytest.mark.parametrize("lost", [[], [7], [7, 8, 30], [1, 2, 3, 4, 48]])
def test_missing_frames_are_found_where_a_camera_lost_them(lost: list[int]) -> None:
    times = 3 + np.arange(50) / 25.0
    jitter = np.random.default_rng(3).uniform(-0.004, 0.004, 50)
    np.testing.assert_allclose(with_missing(np.delete(times, lost)), times, atol=1e-12)
    assert len(with_missing(np.delete(times + jitter, lost))) == 50
    np.testing.assert_array_equal(with_missing(times[[0, 9]]), times[[0, 9]])


@pytest.mark.parametrize(("fps", "decimals"), [(30, 2), (60, 3), (60, 2), (24, 2), (120, 3)])
@pytest.mark.parametrize("lost", [[], [3, 4, 5, 50, 51]])
def test_rounded_times_have_the_rate_of_all_frames(
    fps: float, decimals: int, lost: list[int]
) -> None:
    times = np.delete((np.arange(180) / fps).round(decimals), lost)
    assert frame_rate(times) == pytest.approx(fps, rel=0.005)
    assert len(with_missing(times)) == 180


def test_a_pause_of_more_frames_than_a_motion_may_have_is_refused() -> None:
    with pytest.raises(ValueError, match=r"1e\+09 s without any after 0.04 s"):
        with_missing(np.array([0, 0.02, 0.04, 1e9]))
