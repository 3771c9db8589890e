"""Distances between the joints of two bodies, as functions of time."""

from dataclasses import dataclass

import numpy as np

from pacmo_core.metrics.body import Body
from pacmo_core.metrics.intervals import Array
from pacmo_core.metrics.reactions import Reactions
from pacmo_core.metrics.resampling import to_length


def distance_functions(row: Reactions, body: Body, n_instants: int) -> Array:
    """Follow the distance from each key joint of the partner to each of the reaction.

    Unlike features of the motions, these change with any change of who answers whom.

    Returns
    -------
    (n, K², r) metres, at r instants from the first to the last
    """
    keys = list(body.keys)
    found = []
    for partner, motion, times in zip(row.partners, row.motions, row.times, strict=True):
        gaps = np.linalg.norm(partner[:, keys, None] - motion[:, None, keys], axis=-1)
        flat = gaps.reshape(len(times), -1, 1)
        found.append(to_length(flat, times, n_instants)[:, :, 0].T)
    return np.stack(found)


@dataclass(frozen=True)
class Components:
    """The few functions by which distances between bodies vary most, in real training data.

    F²ID grows with the square of the dimension (for few samples, mostly by bias), and K² functions
    on r instants are many: so they are seen in their principal components.

    Parameters
    ----------
    mean : (K², 1) metres
    scale : (K², 1) metres
    axes : (K²·r, k), orthonormal
    """

    mean: Array
    scale: Array
    axes: Array

    def coordinates(self, functions: Array) -> Array:
        """See (n, K², r) functions in the components, (n, k), as L²(time) measures."""
        flat = ((functions - self.mean) / self.scale).reshape(len(functions), -1)
        return np.asarray(flat @ self.axes / np.sqrt(functions.shape[-1]))


def components_of(functions: Array, n_components: int) -> Components:
    """Find the principal components of standardised functions (n, K², r), at most so many."""
    mean = functions.mean(axis=(0, 2))[:, None]
    scale = functions.std(axis=(0, 2))[:, None]
    if not (scale > 0).all():
        raise ValueError("wanted distances that vary; one is the same in all real training data")
    flat = ((functions - mean) / scale).reshape(len(functions), -1)
    _, lengths, axes = np.linalg.svd(flat - flat.mean(axis=0), full_matrices=False)
    resolved = lengths > lengths[0] * np.finfo(np.float64).eps * max(flat.shape)
    return Components(mean, scale, axes[: min(n_components, int(resolved.sum()))].T)
