"""Interactions seen from the partner: moved into its first frame, dealt to another partner."""

from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.transforms import body_frame


def seen_from_partner(interaction: Interaction) -> Interaction:
    """Move both people into the frame of the partner's (``person_a``'s) first pose."""
    frame = body_frame(interaction.person_a, interaction.skeleton)
    return replace(
        interaction,
        person_a=frame.to_local(interaction.person_a),
        person_b=frame.to_local(interaction.person_b),
    )


def dealt_to(partner: Interaction, reaction: Interaction) -> Interaction:
    """Give a partner the reaction to another one, both seen from their partners.

    The reaction keeps its place before its own partner and is played over the other's duration.
    """
    own = np.linspace(0, 1, len(partner.times))
    share = (reaction.times - reaction.times[0]) / reaction.duration
    motion = CubicSpline(share, reaction.person_b)(own).astype(np.float32)
    return replace(partner, person_b=motion)
