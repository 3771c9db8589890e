"""Who touches whom: distances between the joints of two people."""

import numpy as np
from numpy.typing import NDArray

from pacmo_core.interaction import Interaction


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
