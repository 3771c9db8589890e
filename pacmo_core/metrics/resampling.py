"""Motions of any length and clock on a common number of frames."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


def to_length(
    motion: NDArray[np.float32], times: NDArray[np.float64], n_frames: int
) -> NDArray[np.float64]:
    """Resample a motion to frames at equal distances from its first to its last instant.

    Linear between frames: a spline would overshoot at the jumps of noisy captures.

    Parameters
    ----------
    motion : (T, J, 3) metres
    times : (T,) seconds, strictly increasing
    n_frames : at least 2

    Returns
    -------
    (n_frames, J, 3) float64, metres
    """
    if len(times) != len(motion) or n_frames < 2:
        raise ValueError(
            f"wanted one time a frame and at least 2 frames; got {len(times)} times, "
            f"{len(motion)} frames, n_frames {n_frames}"
        )
    wanted = np.linspace(times[0], times[-1], n_frames)
    after = np.searchsorted(times, wanted, side="left").clip(1, len(times) - 1)
    share = (wanted - times[after - 1]) / (times[after] - times[after - 1])
    share = share[:, None, None]
    values = motion.astype(np.float64)
    return np.asarray((1 - share) * values[after - 1] + share * values[after])


def stack_motions(
    motions: Sequence[NDArray[np.float32]], times: Sequence[NDArray[np.float64]], n_frames: int
) -> NDArray[np.float64]:
    """Resample n motions into one array (n, n_frames, J·3), metres."""
    pairs = zip(motions, times, strict=True)
    return np.stack([to_length(m, t, n_frames).reshape(n_frames, -1) for m, t in pairs])
