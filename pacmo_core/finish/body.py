"""The body of a person: bones, and where the root lies over the hips.

Skeletons differ in what they call the root. Kinect's is two centimetres over the middle of the
hips, SMPL's and CMU's nine: with the directions of one skeleton's bones and the lengths of
another's, hips stick out and the back has a kink. So a pelvis is taken over as a whole.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.interaction import Motion
from pacmo_core.data.segments import feet
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.finish.bones import (
    MIN_LENGTH,
    leg_joints,
    leg_length,
    median_lengths,
    set_bone_lengths,
    set_legs,
)

Array = NDArray[np.float64]
# Times as tall as the partner that a generated body may be, or as small: beyond it is a child or a
# giant beside the other.
MAX_SIZE_RATIO = 1.25


@dataclass(frozen=True)
class Pelvis:
    """Joints of a skeleton that make a pelvis, and a joint of the spine, which says where up is."""

    root: int
    left: int
    right: int
    spine: int

    def frame(self, motion: Array) -> tuple[Array, Array]:
        """Return the middle of the hips, (T, 3), and the axes left, up and ahead, (T, 3, 3).

        Axes are the columns; up is at right angles to left, towards the spine.
        """
        middle = (motion[:, self.left] + motion[:, self.right]) / 2
        left = _unit(motion[:, self.left] - motion[:, self.right])
        spine = motion[:, self.spine] - middle
        up = _unit(spine - (spine * left).sum(axis=-1, keepdims=True) * left)
        return middle, np.stack([left, up, np.cross(left, up)], axis=-1)


@dataclass(frozen=True)
class TargetBody:
    """A body that a motion is given.

    Parameters
    ----------
    lengths : (E,) metres, of the bones
    root : (3,) metres, from the middle of the hips to the root, along ``Pelvis.frame``; None of a
        skeleton without named hips
    hip_distance : metres, from one hip to the other
    """

    lengths: Array
    root: Array | None = None
    hip_distance: float = 0.0


def find_pelvis(skeleton: Skeleton) -> Pelvis | None:
    """Find the pelvis; None where no two mirrored joints at the root carry the legs."""
    root, parents = skeleton.root, skeleton.parents
    hips = {parents[parents[foot[0]]] for foot in feet(skeleton)}
    others = [joint for joint, parent in enumerate(parents) if parent == root and joint not in hips]
    for left, right in skeleton.left_right:
        if {left, right} == hips and parents[left] == parents[right] == root and others:
            return Pelvis(root, left, right, others[0])
    return None


def body_of(motion: Motion, skeleton: Skeleton) -> TargetBody:
    """Measure the body of a motion ``(T, J, 3)``, metres: medians over time."""
    lengths, pelvis = median_lengths(motion, skeleton), find_pelvis(skeleton)
    if pelvis is None:
        return TargetBody(lengths)
    joints = motion.astype(np.float64)
    middle, axes = pelvis.frame(joints)
    roots = np.einsum("tx,txa->ta", joints[:, pelvis.root] - middle, axes)
    apart = np.linalg.norm(joints[:, pelvis.left] - joints[:, pelvis.right], axis=-1)
    return TargetBody(lengths, np.median(roots, axis=0), float(np.median(apart)))


def is_plausible(lengths: Array, partner: Array, skeleton: Skeleton) -> bool:
    """Whether a generated body is about as tall as the partner's, by the legs.

    To motion that is unlike that of the training a network may answer with giants, of 15 m even.

    Parameters
    ----------
    lengths, partner : (E,) metres, of the bones of either
    skeleton : of both
    """
    ratio = leg_length(lengths, skeleton) / leg_length(partner, skeleton)
    return not feet(skeleton) or 1 / MAX_SIZE_RATIO <= ratio <= MAX_SIZE_RATIO


def with_body(motion: Array, body: TargetBody, ground: Array, skeleton: Skeleton) -> Array:
    """Give a motion another body where it stands.

    Heights over the ground are in proportion to the legs; the pelvis is that of the body, the
    directions of other bones stay, and so do the places of the feet over the ground, from which the
    legs are set.

    Parameters
    ----------
    motion : (T, J, 3) metres, y up
    body : TargetBody
    ground : (T,) metres, height of the ground beneath the motion
    skeleton : of the motion
    """
    own = median_lengths(motion.astype(np.float32), skeleton)
    ratio = leg_length(body.lengths, skeleton) / leg_length(own, skeleton)
    nearer = motion.copy()
    nearer[..., 1] = ground[:, None] + ratio * (motion[..., 1] - ground[:, None])
    pelvis = find_pelvis(skeleton)
    if pelvis is None or body.root is None:
        moved = motion + (nearer - motion)[:, [skeleton.root]]
    else:
        moved = _with_pelvis(motion, nearer, pelvis, body.root, body.hip_distance, skeleton)
    result = set_bone_lengths(moved, body.lengths, skeleton)
    set_legs(result, nearer, np.full(motion.shape[:2], -np.inf), body.lengths, skeleton)
    return result


def _with_pelvis(
    motion: Array,
    nearer: Array,
    pelvis: Pelvis,
    root: Array,
    hip_distance: float,
    skeleton: Skeleton,
) -> Array:
    """Put the middle of the hips where it is in ``nearer``, and the root over it as in the body."""
    (middle, _), (_, axes) = pelvis.frame(nearer), pelvis.frame(motion)
    at = middle + np.einsum("txa,a->tx", axes, root)
    moved = motion + (at - motion[:, pelvis.root])[:, None]
    aside = hip_distance / 2 * axes[:, :, 0]
    for hip, place in ((pelvis.left, middle + aside), (pelvis.right, middle - aside)):
        below = [joint for joint in leg_joints(skeleton) if hip in skeleton.ancestors(joint)]
        moved[:, below] += (place - moved[:, hip])[:, None]
        moved[:, hip] = place
    return np.asarray(moved)


def _unit(vectors: Array) -> Array:
    norm = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.maximum(norm, MIN_LENGTH), dtype=np.float64)
