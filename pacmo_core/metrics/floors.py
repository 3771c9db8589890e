"""Second draws of real motion, to learn what a metric says of two samples of one law."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Indices = NDArray[np.intp]


def second_draws(
    clips: Sequence[str], n: int, n_draws: int, generator: np.random.Generator
) -> list[Indices]:
    """Draw n samples clip by clip, without replacement, so many times; last clips may be cut short.

    Parameters
    ----------
    clips : the clip of each sample
    n : samples a draw
    n_draws : draws, each from all samples

    Returns
    -------
    ``n_draws`` times (n,) int; where there are no more than n samples, one draw of all of them
    """
    if len(clips) <= n:
        return [np.arange(len(clips))]
    return [_shuffled_by_clip(clips, generator)[:n] for _ in range(n_draws)]


def halves_by_clip(clips: Sequence[str], generator: np.random.Generator) -> tuple[Indices, Indices]:
    """Deal samples into two halves that share no clip, their numbers as equal as clips allow.

    Raises
    ------
    ValueError
        If there are fewer than two clips.
    """
    order = _shuffled_by_clip(clips, generator)
    names = np.asarray(clips)[order]
    starts = np.flatnonzero(names[1:] != names[:-1]) + 1
    if not len(starts):
        raise ValueError(f"halves by clip want at least 2 clips; got {sorted(set(clips))}")
    cut = starts[np.argmin(np.abs(starts - len(order) / 2))]
    return order[:cut], order[cut:]


def _shuffled_by_clip(clips: Sequence[str], generator: np.random.Generator) -> Indices:
    """Order samples so that clips stand together, the clips in random order."""
    _, codes = np.unique(np.asarray(clips), return_inverse=True)
    rank = generator.permutation(int(codes.max()) + 1)
    return np.argsort(rank[codes], kind="stable")
