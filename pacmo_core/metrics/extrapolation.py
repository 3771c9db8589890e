"""F²ID as it would be of infinitely many samples.

F²ID of n samples exceeds that of the laws by about a/n. So it is measured on parts of the clips
too, and a line in 1/n is drawn to 1/n = 0, as Chong and Forsyth (2020), *Effectively unbiased FID
and Inception Score*, do for images.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Codes = NDArray[np.intp]

# Parts are made of quarters of the clips: all, three of four, and two; and 4 / (quarters) is 1/n.
_QUARTERS = (
    ((0, 1, 2, 3),),
    ((1, 2, 3), (0, 2, 3), (0, 1, 3), (0, 1, 2)),
    ((0, 1), (2, 3)),
)
N_PARTS = sum(map(len, _QUARTERS))


def deal_parts(counts: Array, groups: Codes, generator: np.random.Generator) -> Array:
    """Deal the clips of each draw into quarters, and join these to the parts of three sizes.

    Parameters
    ----------
    counts : (B, G) whole numbers, how often each draw took each clip
    groups : (G,) int; each group (test clips, training clips) is dealt for itself

    Returns
    -------
    (B, P, G) how often each part holds each clip: everything first, then by falling size
    """
    quarters = np.zeros((len(counts), 4, counts.shape[1]))
    for draw, into in zip(counts.astype(np.intp), quarters, strict=True):
        for group in np.unique(groups):
            members = np.flatnonzero(groups == group)
            drawn = generator.permutation(np.repeat(members, draw[members]))
            for quarter, clips in zip(into, np.array_split(drawn, 4), strict=True):
                np.add.at(quarter, clips, 1)
    joined = [quarters[:, list(part)].sum(axis=1) for size in _QUARTERS for part in size]
    return np.stack(joined, axis=1)


def extrapolate(values: Array) -> Array:
    """Draw the least-squares line in 1/n through the means of each size, and read it off at 0.

    Parameters
    ----------
    values : (..., P), the metric on each of ``deal_parts``' parts

    Returns
    -------
    (...)
    """
    parts = np.split(values, np.cumsum([len(size) for size in _QUARTERS])[:-1], axis=-1)
    means = np.stack([part.mean(axis=-1) for part in parts], axis=-1)
    inverse = np.array([4 / len(size[0]) for size in _QUARTERS])
    line = np.stack([inverse, np.ones(len(inverse))], axis=1)
    return np.asarray(means @ np.linalg.pinv(line)[1])
