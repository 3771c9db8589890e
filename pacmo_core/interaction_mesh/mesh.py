"""The terms of the energy within a frame: interaction mesh, contact, posture, root, heights.

Laplacian coordinates after Ho, Komura and Tai (2010), *Spatial relationship preserving character
motion adaptation*. Every joint of one body is connected with every joint of the other, after
section 1 of the supplement of Li et al. (2024), *Two-person interaction augmentation with skeleton
priors*; unlike there, with weights that vanish at a distance, so that a bystander stays as he is.
All of this depends on the source only, not on the target bodies.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_opening, gaussian_filter1d

from pacmo_core.interaction_mesh.body_parts import (
    ancestor_bones,
    bone_to_joint,
    hinges,
    is_hand,
    posture_weights,
    trunk_joints,
    trunk_pairs,
)
from pacmo_core.interaction_mesh.scene import Array, Scene
from pacmo_core.interaction_mesh.settings import Posture, Support, Weights

# Metres: bones of this length have their posture weight as it is set; shorter ones more, so that
# the weight is on angles.
REFERENCE_LENGTH = 0.3
HINGE_LENGTH = 0.4  # metres of lower limb that an angle of a hinge moves
# Metres over which the lowest joints of a person share what keeps them at their height.
LOWEST_RANGE = 0.03
# A person whose lowest joint is this many metres above the floor is in the air, where the root is
# held by this fraction of its weight.
AIRBORNE_HEIGHT, AIRBORNE_FRACTION = 0.2, 0.09
# Seconds: the longest time in which nothing supports a body that jumps.
MAX_FLIGHT = 0.75
# Metres above the lowest joint at which the weight of heights has fallen to 1/e.
FLOOR_RANGE = 0.05


@dataclass(frozen=True)
class LinearTerm:
    """The term ``1/2 sum_t |rows U_t - factors ((s - 1) v_t)|^2``, v the bone vectors.

    Parameters
    ----------
    rows : (T, R, N) or (R, N)
    factors : (T, R, E) or (R, E)
    """

    rows: Array
    factors: Array


@dataclass(frozen=True)
class HeightTerm:
    """The term ``1/2 sum_t sum_i weights (U_y - targets (s - 1))^2``.

    Parameters
    ----------
    weights : (T, N)
    targets : (T, N, E) metres
    """

    weights: Array
    targets: Array


def linear_terms(scene: Scene, weights: Weights) -> Iterator[LinearTerm]:
    """Yield Laplacian deformation, posture, hinges and trunk shape."""
    yield laplacian_term(scene, weights)
    yield posture_term(scene, weights.posture)
    yield hinge_term(scene, weights.posture)
    yield trunk_shape_term(scene, weights.trunk_shape)


def laplacian_term(scene: Scene, weights: Weights) -> LinearTerm:
    """Return L of each frame, ``(L p)_i = p_i - sum_j w_ij p_j``, and what scaled bones do to it.

    A scaled bone moves either end in the Laplacian coordinates of the other, by the edge's weight.
    """
    laplacians = laplacian_matrices(scene, weights)
    parent, child = scene.bones.T
    factors = np.zeros((*laplacians.shape[:2], len(parent)))
    bones = np.arange(len(parent))
    factors[:, parent, bones] += laplacians[:, parent, child]
    factors[:, child, bones] -= laplacians[:, child, parent]
    return LinearTerm(laplacians, factors)


def laplacian_matrices(scene: Scene, weights: Weights) -> Array:
    """``(T, N, N)``: weights fall with the distance in the source, and each row sums to zero.

    ``w_ij ~ 1 / (d_ij + softening)``, times ``exp(-(d_ij / interaction_range)^2)`` between the two
    bodies.
    """
    distances = joint_distances(scene.points)
    edges = 1 / (distances + weights.distance_softening)
    between = np.exp(-np.square(distances / weights.interaction_range)) * inter_body_mask(scene)
    edges *= between + _bone_mask(scene)
    edges = _smooth(edges, scene.fps, weights.smoothing_time)
    edges /= edges.sum(axis=-1, keepdims=True)
    laplacians: Array = np.eye(edges.shape[-1]) - edges
    return laplacians


def posture_term(scene: Scene, posture: Posture) -> LinearTerm:
    """Ask every bone to grow along its own direction; the weight is on its angle."""
    weights = posture_weights(scene, posture) * (REFERENCE_LENGTH / _mean_lengths(scene))
    roots = np.sqrt(weights)
    return LinearTerm(roots[:, None] * _bone_differences(scene), np.diag(roots))


def hinge_term(scene: Scene, posture: Posture) -> LinearTerm:
    """Ask both bones of a knee or elbow to turn alike, so that its angle stays."""
    limbs, names = hinges(scene)
    bends = trunk_pairs(scene)
    pairs = np.concatenate([limbs, bends])
    weight_of = {"knee": posture.knee, "elbow": posture.elbow, "spine": posture.spine}
    weights = [weight_of[name] for name in (*names, *["spine"] * len(bends))]
    roots = HINGE_LENGTH * np.sqrt(weights)
    lengths, rows = _mean_lengths(scene), np.arange(len(pairs))
    factors = np.zeros((len(pairs), len(lengths)))
    for end, sign in ((1, 1), (0, -1)):
        factors[rows, pairs[:, end]] = sign * roots / lengths[pairs[:, end]]
    return LinearTerm(factors @ _bone_differences(scene), factors)


def trunk_shape_term(scene: Scene, weight: float) -> LinearTerm:
    """Ask trunk joints to keep their positions relative to their trunk's mean.

    Without this term a smaller body folds its hips and shoulders together, as bones that share a
    joint turn freely against each other.
    """
    identity, blocks = np.eye(scene.points.shape[1]), []
    for joints in trunk_joints(scene):
        rows = identity[joints]
        blocks.append(rows - rows.mean(axis=0) if len(joints) else rows)
    relative: Array = np.sqrt(weight) * np.concatenate(blocks)
    return LinearTerm(relative, relative @ ancestor_bones(scene))


def contact_hessians(scene: Scene, weights: Weights) -> Array:
    """``(T, N, N)``: the part of H of the contacts, whose displacements should be equal.

    ``c_ij = exp(-(d_ij / contact_range)^4)``, normalised so that a joint in contact with many
    divides its weight among them: ``w_ij = contact c_ij / sqrt(s_i s_j)`` with ``s_i`` the larger
    of 1 and the sum of ``c_ij`` over j.
    """
    closeness = np.exp(-((joint_distances(scene.points) / weights.contact_range) ** 4))
    hand = is_hand(scene)
    closeness *= np.where(hand[:, None] | hand, 1, weights.body_contact) * inter_body_mask(scene)
    closeness = _smooth(closeness, scene.fps, weights.smoothing_time)
    norms = np.sqrt(closeness.sum(axis=-1).clip(min=1))
    hessians: Array = -weights.contact * closeness / (norms[:, :, None] * norms[:, None])
    points = np.arange(hessians.shape[1])
    hessians[:, points, points] -= hessians.sum(axis=-1)
    return hessians


def root_term(scene: Scene, weights: Weights) -> tuple[Array, HeightTerm]:
    """Return the weight on each root in all directions, (T, N), and the height that it should take.

    The height of the root that keeps the person's lowest joints where they are, if all bones grow
    along their own directions.
    """
    ancestors, heights = ancestor_bones(scene), scene.points[..., 1]
    by_root = np.zeros(heights.shape)
    targets = np.zeros((*heights.shape, len(scene.bones)))
    shares = (weights.yielding, 1 / weights.yielding)
    for (joints, root), share_of_person in zip(_people(scene), shares, strict=True):
        lowest = heights[:, joints].min(axis=1)
        share = np.exp(-(heights[:, joints] - lowest[:, None]) / LOWEST_RANGE)
        share /= share.sum(axis=1, keepdims=True)
        targets[:, root] = -(share @ ancestors[joints]) * scene.bone_vectors[..., 1]
        above = (lowest - scene.levels.lowest[root]) / AIRBORNE_HEIGHT
        standing = np.exp(-(above.clip(min=0) ** 4))
        in_contact = AIRBORNE_FRACTION + (1 - AIRBORNE_FRACTION) * standing
        by_root[:, root] = weights.root * share_of_person * in_contact
    return by_root, HeightTerm(by_root, targets)


def height_term(scene: Scene, weights: Weights, supports: Array) -> HeightTerm:
    """Return what holds supporting joints, and joints near the floor, at their height.

    A joint's height grows with the bone below it, or beside it at the end of a limb.
    """
    heights = scene.points[..., 1]
    near, targets = np.zeros(heights.shape), np.zeros((*heights.shape, len(scene.bones)))
    bone_of = bone_to_joint(scene)
    for joints, root in _people(scene):
        lowest = scene.levels.lowest[root]
        near[:, joints] = np.exp(-np.square((heights[:, joints] - lowest) / FLOOR_RANGE))
        for joint in joints.tolist():
            below = [row for row, (parent, _) in enumerate(scene.bones.tolist()) if parent == joint]
            bones = [bone_of[joint]] if joint != root and not below else below
            targets[:, joint, bones] = (heights[:, joint] - lowest)[:, None] / len(bones)
    return HeightTerm(weights.stance_height * supports + weights.floor_height * near, targets)


def joint_distances(points: Array) -> Array:
    """``(T, N, N)`` metres."""
    squares = np.zeros((len(points), points.shape[1], points.shape[1]))
    for axis in range(3):
        squares += np.square(points[:, :, None, axis] - points[:, None, :, axis])
    distances: Array = np.sqrt(squares, out=squares)
    return distances


def inter_body_mask(scene: Scene) -> Array:
    """``(N, N)`` ones where the two joints are of different bodies."""
    body = np.repeat([0, 1], scene.n_joints)
    mask: Array = (body[:, None] != body).astype(np.float64)
    return mask


def _bone_mask(scene: Scene) -> Array:
    mask = np.zeros((sum(scene.n_joints),) * 2)
    parent, child = scene.bones.T
    mask[parent, child] = mask[child, parent] = 1
    return mask


def _bone_differences(scene: Scene) -> Array:
    """``(E, N)``: the end of each bone less its beginning."""
    identity = np.eye(sum(scene.n_joints))
    parent, child = scene.bones.T
    differences: Array = identity[child] - identity[parent]
    return differences


def _mean_lengths(scene: Scene) -> Array:
    lengths: Array = np.linalg.norm(scene.bone_vectors, axis=-1).mean(axis=0)
    return lengths


def _people(scene: Scene) -> Iterator[tuple[NDArray[np.intp], int]]:
    """Yield the points of each person, and which of them is the root."""
    first = 0
    for skeleton in scene.skeletons:
        joints = np.arange(first, first + len(skeleton.joints))
        yield joints, first + skeleton.root
        first += len(joints)


def _smooth(weights: Array, fps: float, seconds: float) -> Array:
    """Smooth over time, so that weights that rise and fall cause no jerk."""
    if not seconds:
        return weights
    smoothed: Array = gaussian_filter1d(weights, seconds * fps, axis=0, mode="nearest")
    return smoothed


def ground_supports(scene: Scene, support: Support) -> NDArray[np.bool_]:
    """Whether a joint supports its body, ``(T, N)``: it is low, near the ground, and slow.

    Feet, and hands and knees where they bear weight.
    """
    heights = scene.points[..., 1]
    level = scene.levels.joints
    is_low = heights < level + support.height_tolerance
    is_near_ground = level < scene.ground_height + support.max_height
    return is_low & is_near_ground & (_joint_speeds(scene) < support.max_speed)


def carrying_joints(
    scene: Scene, support: Support, is_support: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Which joints carry their body, ``(T, N)``: those that support it, or else its lowest.

    The feet of a noisy sensor are never slow. Where nothing supports a body for longer than a jump
    lasts, its lowest joint carries it, if it is near the ground: without it a child would hover at
    the height of the adult whose place it takes.
    """
    carries = is_support.copy()
    longer = np.ones(1 + int(MAX_FLIGHT * scene.fps), dtype=bool)
    for joints, root in _people(scene):
        heights = scene.points[:, joints, 1]
        is_low = heights.min(axis=1) < scene.levels.lowest[root] + support.max_height
        unsupported = np.asarray(~is_support[:, joints].any(axis=1))
        is_free = binary_opening(unsupported, longer)
        frames = np.flatnonzero(is_free & is_low)
        carries[frames, joints[heights[frames].argmin(axis=1)]] = True
    return carries


def support_weights(
    is_support: NDArray[np.bool_], fps: float, fade_time: float
) -> NDArray[np.float64]:
    """``(T, N)``: 1 where a joint supports; ``exp(-(t / fade_time)^2)`` t seconds from that."""
    weights = is_support.astype(np.float64)
    for shift in range(1, min(len(weights), int(3 * fade_time * fps) + 1)):
        faded = np.exp(-((shift / fps / fade_time) ** 2))
        weights[shift:] = np.maximum(weights[shift:], faded * is_support[:-shift])
        weights[:-shift] = np.maximum(weights[:-shift], faded * is_support[shift:])
    return weights


def support_steps(is_support: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """``(T - 1, N)``: whether a joint supports in a frame and in the next."""
    return is_support[1:] & is_support[:-1]


def _joint_speeds(scene: Scene) -> NDArray[np.float64]:
    """``(T, N)`` metres per second; the smaller of the speeds before and after a frame."""
    speeds = np.linalg.norm(np.diff(scene.points, axis=0), axis=-1) * scene.fps
    if not len(speeds):
        return np.zeros(scene.points.shape[:2])
    before = np.concatenate([speeds[:1], speeds])
    after = np.concatenate([speeds, speeds[-1:]])
    smaller: NDArray[np.float64] = np.minimum(before, after)
    return smaller
