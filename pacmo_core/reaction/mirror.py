"""The mirror image of an interaction: left for right, of both people."""

from dataclasses import replace

import numpy as np

from pacmo_core.data.interaction import Interaction, Motion
from pacmo_core.data.skeleton import Skeleton


def mirrored(interaction: Interaction) -> Interaction:
    """Reflect both people in the plane x = 0 and exchange their left and right joints.

    People move the same way left-handed, so a mirror image is another interaction of the same law.
    """
    return replace(
        interaction,
        person_a=_reflected(interaction.person_a, interaction.skeleton),
        person_b=_reflected(interaction.person_b, interaction.skeleton),
    )


def _reflected(motion: Motion, skeleton: Skeleton) -> Motion:
    order = np.arange(motion.shape[1])
    for left, right in skeleton.left_right:
        order[left], order[right] = right, left
    return np.ascontiguousarray(motion[:, order] * np.array([-1, 1, 1], dtype=np.float32))
