"""Plausibility of reactions: foot skate, inter-penetration, contact, distances between bodies.

The joints that these metrics use (root, feet, hands, head) are found by name in any skeleton.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.interaction import Motion, min_point_distance
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.metrics.bootstrap import Array
from pacmo_core.metrics.reactions import Reactions, to_length

# Of each limb the first word that names a joint of either side; data sets differ in what they have.
_FEET = ("foot", "toe", "ankle", "heel")
_HANDS = ("hand", "wrist")


@dataclass(frozen=True)
class BodyJoints:
    """What metrics need to know of a skeleton.

    Parameters
    ----------
    root : index of the root joint
    keys : indices of the joints whose distances between two bodies are looked at
    feet : indices of the joints that stand on the ground; none if the skeleton names none
    bones : (E, 2) indices, parent and child
    """

    root: int
    keys: tuple[int, ...]
    feet: tuple[int, ...]
    bones: NDArray[np.intp]


def find_body_joints(skeleton: Skeleton) -> BodyJoints:
    """Find root, head, hands and feet by name; without any of these, every joint is a key."""
    feet, hands = _left_and_right(skeleton, _FEET), _left_and_right(skeleton, _HANDS)
    head = tuple(i for i, name in enumerate(skeleton.joints) if "head" in name.lower())[:1]
    result = sorted({skeleton.root, *head, *hands, *feet})
    complete = bool(head and hands and feet)
    keys = tuple(result) if complete else tuple(range(len(skeleton.joints)))
    return BodyJoints(root=skeleton.root, keys=keys, feet=feet, bones=skeleton.bones)


def _left_and_right(skeleton: Skeleton, words: tuple[str, ...]) -> tuple[int, ...]:
    """Find the mirror joints of a limb's end by the first word that names any."""
    paired = sorted({joint for pair in skeleton.left_right for joint in pair})
    for word in words:
        named = tuple(i for i in paired if word in skeleton.joints[i].lower())
        if named:
            return named
    return ()


# Share of a real clip's foot heights below the ground that is taken from them: noise, not ground.
GROUND_TOLERANCE = 0.05


def foot_skate(row: Reactions, real: Reactions, body: BodyJoints, *, height: float) -> Array:
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
        ground = np.quantile(known[:, feet, 1], GROUND_TOLERANCE)
        low = motion[:, feet, 1] < ground + height
        standing = low[1:] & low[:-1]
        step = np.linalg.norm(np.diff(motion[:, feet][..., [0, 2]], axis=0), axis=-1)
        speed = step / np.diff(times)[:, None]
        sums.append((speed[standing].sum(), standing.sum()))
    return np.array(sums, dtype=np.float64).T


def penetration(row: Reactions, body: BodyJoints, *, radius: float) -> Array:
    """Count the frames in which the bodies merge, (2, n): such frames, and all.

    Bodies merge where joints or middles of bones, one of either, are within ``radius`` metres: two
    limbs of half that thickness would share a place. The frequency of intersection as of ReGenNet
    (Xu et al. 2024) and its followers, with points for meshes.
    """
    merged = [
        (min_point_distance(body_points(partner, body), body_points(motion, body)) < radius).sum()
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
        result, wanted = (
            min_point_distance(partner, motion) <= distance for motion in (ours, theirs)
        )
        sums.append((2 * (result & wanted).sum(), result.sum() + wanted.sum()))
    return np.array(sums, dtype=np.float64).T


def body_points(motion: Motion, body: BodyJoints) -> Motion:
    """List the joints and the middles of the bones, (T, J + E, 3) metres."""
    return np.concatenate([motion, motion[:, body.bones].mean(axis=2)], axis=1)


def distance_functions(row: Reactions, body: BodyJoints, n_instants: int) -> Array:
    """Follow the distance from each key joint of the partner to each of the reaction.

    Unlike features of the motions, these change with any change of who answers whom.

    Returns
    -------
    (n, K², r) metres, at r instants from the first to the last
    """
    keys = list(body.keys)
    result = []
    for partner, motion, times in zip(row.partners, row.motions, row.times, strict=True):
        gaps = np.linalg.norm(partner[:, keys, None] - motion[:, None, keys], axis=-1)
        flat = gaps.reshape(len(times), -1, 1)
        result.append(to_length(flat, times, n_instants)[:, :, 0].T)
    return np.stack(result)


@dataclass(frozen=True)
class PrincipalComponents:
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


def fit_principal_components(functions: Array, n_components: int) -> PrincipalComponents:
    """Find the principal components of standardised functions (n, K², r), at most so many."""
    mean = functions.mean(axis=(0, 2))[:, None]
    scale = functions.std(axis=(0, 2))[:, None]
    if not (scale > 0).all():
        raise ValueError("wanted distances that vary; one is the same in all real training data")
    flat = ((functions - mean) / scale).reshape(len(functions), -1)
    _, lengths, axes = np.linalg.svd(flat - flat.mean(axis=0), full_matrices=False)
    resolved = lengths > lengths[0] * np.finfo(np.float64).eps * max(flat.shape)
    return PrincipalComponents(mean, scale, axes[: min(n_components, int(resolved.sum()))].T)
