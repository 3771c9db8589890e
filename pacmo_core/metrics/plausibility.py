"""What a reader of the field looks for first: feet that slide, bodies that merge, contact.

Each metric here is a ratio of sums over samples, so each function gives two numbers a sample: what
is summed, and what it is divided by. A bootstrap weighs both by clip.
"""

import numpy as np

from pacmo_core.data.interaction import Motion, min_point_distance
from pacmo_core.metrics.body import Body
from pacmo_core.metrics.intervals import Array
from pacmo_core.metrics.reactions import Reactions

# Share of a real clip's foot heights below the ground that is taken from them: noise, not ground.
BELOW_GROUND = 0.05


def foot_sliding(row: Reactions, real: Reactions, body: Body, *, height: float) -> Array:
    """Sum the horizontal speed of feet that stand, (2, n): metres a second, and foot-frames.

    A foot stands where it is less than ``height`` above the ground at both ends of a step of the
    clock; the ground is that of the real reaction's feet in the same clip. As Kovar et al. (2002),
    *Footskate cleanup*, see sliding; thresholds are ours.

    Parameters
    ----------
    row : reactions to the same partners as ``real``
    height : metres
    """
    feet = list(body.feet)
    sums = []
    for motion, known, times in zip(row.motions, real.motions, row.times, strict=True):
        ground = np.quantile(known[:, feet, 1], BELOW_GROUND)
        low = motion[:, feet, 1] < ground + height
        standing = low[1:] & low[:-1]
        step = np.linalg.norm(np.diff(motion[:, feet][..., [0, 2]], axis=0), axis=-1)
        speed = step / np.diff(times)[:, None]
        sums.append((speed[standing].sum(), standing.sum()))
    return np.array(sums, dtype=np.float64).T


def penetration(row: Reactions, body: Body, *, radius: float) -> Array:
    """Count the frames in which the bodies merge, (2, n): such frames, and all.

    Bodies merge where joints or middles of bones, one of either, are within ``radius`` metres: two
    limbs of half that thickness would share a place. The frequency of intersection as of ReGenNet
    (Xu et al. 2024) and its followers, with points for meshes.
    """
    merged = [
        (min_point_distance(points_of(partner, body), points_of(motion, body)) < radius).sum()
        for partner, motion in zip(row.partners, row.motions, strict=True)
    ]
    return np.array([merged, [len(motion) for motion in row.motions]], dtype=np.float64)


def contact_agreement(row: Reactions, real: Reactions, *, distance: float) -> Array:
    """Compare the frames with contact with the real ones, (2, n): twice the common, and the sum.

    The ratio is F1 of contact frames, over all samples together; contact is that of joints, as
    ``contacts`` judges whole captures. Duolando (Siyao et al. 2024) reports contact's frequency;
    F1 asks for the same frames.
    """
    sums = []
    for partner, ours, theirs in zip(row.partners, row.motions, real.motions, strict=True):
        found, wanted = (
            min_point_distance(partner, motion) <= distance for motion in (ours, theirs)
        )
        sums.append((2 * (found & wanted).sum(), found.sum() + wanted.sum()))
    return np.array(sums, dtype=np.float64).T


def points_of(motion: Motion, body: Body) -> Motion:
    """List the joints and the middles of the bones, (T, J + E, 3) metres."""
    return np.concatenate([motion, motion[:, body.bones].mean(axis=2)], axis=1)
