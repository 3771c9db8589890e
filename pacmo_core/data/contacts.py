"""Who touches whom: distances between the joints of two people."""

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.interaction import Interaction, Motion


def joint_distances(interaction: Interaction) -> NDArray[np.float32]:
    """``(T, J, J)`` metres: from each joint of person a (rows) to each of person b (columns)."""
    a, b = interaction.person_a, interaction.person_b
    # Joint by joint: all differences at once would take three times the result in passing.
    rows = [np.linalg.norm(b - a[:, [joint]], axis=-1) for joint in range(a.shape[1])]
    return np.stack(rows, axis=1)


def least_distance(interaction: Interaction) -> NDArray[np.float32]:
    """``(T,)`` metres: between the two joints that are closest, one of either person."""
    a, b = interaction.person_a, interaction.person_b
    least = np.full(len(a), np.inf, dtype=np.float32)
    for joint in range(a.shape[1]):
        to_joint = np.linalg.norm(b - a[:, [joint]], axis=-1).min(axis=1)
        least = np.minimum(least, to_joint)
    return least


def contacts(interaction: Interaction, *, distance: float) -> NDArray[np.bool_]:
    """``(T,)``: whether any two joints, one of either person, are within ``distance`` metres."""
    return least_distance(interaction) <= distance


def closest(first: Motion, second: Motion) -> NDArray[np.float64]:
    """``(T,)`` metres: between the closest two points, one of either set, to a micrometre.

    One product of matrices a frame, where ``least_distance`` goes joint by joint: for the many
    motions that metrics compare.

    Parameters
    ----------
    first, second : (T, P, 3), (T, Q, 3) float32, metres
    """
    # About the middle of one, lest a common offset swallow the digits of the identity below.
    centre = first.mean(axis=1, keepdims=True)
    a, b = first - centre, second - centre
    squared = (a**2).sum(axis=-1)[:, :, None] + (b**2).sum(axis=-1)[:, None]
    squared = squared - 2 * a @ b.transpose(0, 2, 1)
    least: NDArray[np.float64] = np.sqrt(squared.min(axis=(1, 2)).clip(0), dtype=np.float64)
    return least
