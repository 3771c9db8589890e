"""Plausibility of reactions: foot skate, penetration, contact, distances between bodies.

The joints that these metrics use (root, feet, hands, head) are found by name in any skeleton.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.interaction import Motion, min_point_distance
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.metrics.bootstrap import Array
from pacmo_core.metrics.reactions import Reactions, to_length

# The first word that names a joint on both sides applies; datasets have different joints.
_FEET = ("foot", "toe", "ankle", "heel")
_HANDS = ("hand", "wrist")


@dataclass(frozen=True)
class BodyJoints:
    """The joints of a skeleton that the metrics use.

    Parameters
    ----------
    root : index of the root joint
    keys : indices of the joints whose distances between two bodies are compared
    feet : indices of the foot joints; empty if no joint has such a name
    bones : (E, 2) indices, parent and child
    """

    root: int
    keys: tuple[int, ...]
    feet: tuple[int, ...]
    bones: NDArray[np.intp]


def find_body_joints(skeleton: Skeleton) -> BodyJoints:
    """Find root, head, hands and feet by name; if one is missing, all joints are keys."""
    feet, hands = _left_and_right(skeleton, _FEET), _left_and_right(skeleton, _HANDS)
    head = tuple(i for i, name in enumerate(skeleton.joints) if "head" in name.lower())[:1]
    named = sorted({skeleton.root, *head, *hands, *feet})
    complete = bool(head and hands and feet)
    keys = tuple(named) if complete else tuple(range(len(skeleton.joints)))
    return BodyJoints(root=skeleton.root, keys=keys, feet=feet, bones=skeleton.bones)


def _left_and_right(skeleton: Skeleton, words: tuple[str, ...]) -> tuple[int, ...]:
    """Find the end joints of left and right limbs by the first word that matches any."""
    paired = sorted({joint for pair in skeleton.left_right for joint in pair})
    for word in words:
        joints = tuple(i for i in paired if word in skeleton.joints[i].lower())
        if joints:
            return joints
    return ()


# Quantile of the foot heights of a real clip that is its ground; lower ones are noise.
GROUND_TOLERANCE = 0.05


def foot_skate(row: Reactions, real: Reactions, body: BodyJoints, *, height: float) -> Array:
    """Return the summed horizontal speed of feet in stance, m/s, and their number, (2, n).

    A foot is in stance between two frames if it is less than ``height`` above the ground in both;
    the ground is that of the real reaction in the same clip. After Kovar et al. (2002), *Footskate
    cleanup*; the thresholds are ours.

    Parameters
    ----------
    row : reactions to the same partners as ``real``
    height : metres
    """
    feet = list(body.feet)
    sums = []
    for motion, real_motion, times in zip(row.motions, real.motions, row.times, strict=True):
        ground = np.quantile(real_motion[:, feet, 1], GROUND_TOLERANCE)
        low = motion[:, feet, 1] < ground + height
        stance = low[1:] & low[:-1]
        step = np.linalg.norm(np.diff(motion[:, feet][..., [0, 2]], axis=0), axis=-1)
        speed = step / np.diff(times)[:, None]
        sums.append((speed[stance].sum(), stance.sum()))
    return np.array(sums, dtype=np.float64).T


def penetration(row: Reactions, body: BodyJoints, *, radius: float) -> Array:
    """Return the number of frames with penetration, and of all frames, (2, n).

    Bodies penetrate where joints or bone midpoints of the two are within ``radius`` metres: limbs
    of half that radius would overlap. This is the intersection frequency of ReGenNet (Xu et al.
    2024), with points in place of meshes.
    """
    n_frames = [
        (min_point_distance(body_points(partner, body), body_points(motion, body)) < radius).sum()
        for partner, motion in zip(row.partners, row.motions, strict=True)
    ]
    return np.array([n_frames, [len(motion) for motion in row.motions]], dtype=np.float64)


def contact_agreement(row: Reactions, real: Reactions, *, distance: float) -> Array:
    """Return twice the frames with contact in both, and the sum of both counts, (2, n).

    Their ratio is the F1 of contact frames over all samples; contact is between joints, as in
    ``contacts`` of whole captures. Duolando (Siyao et al. 2024) reports the frequency of contact;
    F1 requires contact in the same frames.
    """
    sums = []
    for partner, generated, truth in zip(row.partners, row.motions, real.motions, strict=True):
        touching, expected = (
            min_point_distance(partner, motion) <= distance for motion in (generated, truth)
        )
        sums.append((2 * (touching & expected).sum(), touching.sum() + expected.sum()))
    return np.array(sums, dtype=np.float64).T


def body_points(motion: Motion, body: BodyJoints) -> Motion:
    """Return the joints and the midpoints of the bones, (T, J + E, 3) metres."""
    return np.concatenate([motion, motion[:, body.bones].mean(axis=2)], axis=1)


def distance_functions(row: Reactions, body: BodyJoints, n_instants: int) -> Array:
    """Return the distances from each key joint of the partner to each of the reaction over time.

    They depend on the pairing of reactions and partners.

    Returns
    -------
    (n, K², r) metres, at r equally spaced times
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
    """The principal components of distances between bodies in real training data.

    The bias of F²ID for few samples grows with the square of the dimension, and K² functions at r
    times are many; their principal components are few.

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
        """Return the coordinates of (n, K², r) functions, (n, k), in units of L²(time)."""
        flat = ((functions - self.mean) / self.scale).reshape(len(functions), -1)
        return np.asarray(flat @ self.axes / np.sqrt(functions.shape[-1]))


def fit_principal_components(functions: Array, n_components: int) -> PrincipalComponents:
    """Fit at most ``n_components`` components to standardised functions (n, K², r)."""
    mean = functions.mean(axis=(0, 2))[:, None]
    scale = functions.std(axis=(0, 2))[:, None]
    if not (scale > 0).all():
        raise ValueError("wanted distances that vary; one is the same in all real training data")
    flat = ((functions - mean) / scale).reshape(len(functions), -1)
    _, lengths, axes = np.linalg.svd(flat - flat.mean(axis=0), full_matrices=False)
    resolved = lengths > lengths[0] * np.finfo(np.float64).eps * max(flat.shape)
    return PrincipalComponents(mean, scale, axes[: min(n_components, int(resolved.sum()))].T)
