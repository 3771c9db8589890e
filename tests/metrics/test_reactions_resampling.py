"""Trusted: a straight line is itself at any frames, and NumPy's interpolation."""

import numpy as np
import pytest

from pacmo_core.metrics.reactions import stack_motions, to_length


def test_a_straight_motion_is_itself_on_any_clock():
    times = np.array([0.2, 0.25, 0.5, 1.2])
    line = np.multiply.outer(times, np.ones((2, 3))).astype(np.float32)
    found = to_length(line, times, 6)
    np.testing.assert_allclose(found[:, 1, 2], np.linspace(0.2, 1.2, 6), rtol=1e-6)


def test_resampling_is_numpys_joint_by_joint():
    rng = np.random.default_rng(0)
    motion, times = rng.normal(size=(9, 2, 3)), np.cumsum(rng.uniform(0.1, 1, 9))
    found = to_length(motion, times, 20)
    wanted = np.linspace(times[0], times[-1], 20)
    for joint in range(2):
        for axis in range(3):
            expected = np.interp(wanted, times, motion[:, joint, axis])
            np.testing.assert_allclose(found[:, joint, axis], expected, atol=1e-12)


def test_motions_of_all_lengths_stack():
    motions = [np.ones((4, 2, 3), np.float32), np.ones((7, 2, 3), np.float32)]
    stacked = stack_motions(motions, [np.arange(4.0), np.arange(7.0)], 5)
    np.testing.assert_array_equal(stacked, np.ones((2, 5, 6)))
    with pytest.raises(ValueError, match="3 times, 4 frames"):
        to_length(motions[0], np.arange(3.0), 5)
