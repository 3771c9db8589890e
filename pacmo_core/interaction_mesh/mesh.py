"""The interaction mesh of a source, its contacts, trunks and ground supports.

Laplacian coordinates after Ho, Komura and Tai (2010), *Spatial relationship preserving character
motion adaptation*. The default graph connects every joint of one body with every joint of the
other, after section 1 of the supplement of Li et al. (2024), *Two-person interaction augmentation
with skeleton priors*. All of this depends on the source only, not on the target bodies.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.spatial import Delaunay

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.interaction_mesh.scene import Array, Scene
from pacmo_core.interaction_mesh.settings import Support, Weights

# Quantile of a joint's heights that is its lowest level; heights below it are noise.
LOWEST_QUANTILE = 0.05


def laplacian_matrices(scene: Scene, weights: Weights, graph: str) -> Array:
    """Return L of each frame, ``(T, N, N)``: ``(L p)_i = p_i - sum_j w_ij p_j``.

    The weights fall with the distance in the source, ``w_ij ~ 1 / (d_ij + softening)^exponent``,
    and each row of w sums to one.
    """
    edges = 1 / (_joint_distances(scene.points) + weights.distance_softening) ** (
        weights.distance_exponent
    )
    edges *= complete_graph(scene) if graph == "complete" else delaunay_graph(scene)
    edges /= edges.sum(axis=-1, keepdims=True)
    laplacians: Array = np.eye(edges.shape[-1]) - edges
    return laplacians


def contact_weights(scene: Scene, weights: Weights) -> Array:
    """Return the weights of contact between joints of the two bodies, ``(T, N, N)``, symmetric.

    ``c_ij = exp(-(d_ij / contact_range)^4)``, normalised so that a joint in contact with many
    divides its weight among them: ``w_ij = contact c_ij / sqrt(s_i s_j)`` with ``s_i`` the larger
    of 1 and the sum of ``c_ij`` over j.
    """
    closeness = np.exp(
        -np.square(np.square(_joint_distances(scene.points) / weights.contact_range))
    )
    closeness *= inter_body_mask(scene)
    norms = np.sqrt(closeness.sum(axis=-1).clip(min=1))
    contacts: Array = weights.contact * closeness / (norms[:, :, None] * norms[:, None])
    return contacts


def target_matrix(scene: Scene, laplacians: Array, trunk_targets: Array) -> csr_array:
    """Return the matrix from bone scales minus 1 to the target of the energy, ``(3T(N + M), E)``.

    A scaled bone moves either end in the Laplacian coordinates of the other, by the edge's weight.
    The last M rows of a frame are the deformation of trunks whose bones are scaled along their own
    directions.

    Parameters
    ----------
    laplacians : (T, N, N)
    trunk_targets : (M, E), of ``trunk_shape_matrices``
    """
    parent, child = scene.bones.T
    n_frames, n_points, _ = scene.points.shape
    factors = np.zeros((n_frames, n_points + len(trunk_targets), len(parent)))
    bones = np.arange(len(parent))
    factors[:, parent, bones] += laplacians[:, parent, child]
    factors[:, child, bones] -= laplacians[:, child, parent]
    factors[:, n_points:] = trunk_targets
    frame, row, bone = np.nonzero(factors)
    values = factors[frame, row, bone, None] * scene.bone_vectors[frame, bone]
    rows = 3 * (frame * factors.shape[1] + row)[:, None] + np.arange(3)
    indices = (rows.reshape(-1), np.repeat(bone, 3))
    shape = (factors[..., 0].size * 3, len(parent))
    return csr_array((values.reshape(-1), indices), shape=shape)


def inter_body_mask(scene: Scene) -> Array:
    """``(N, N)`` ones where the two joints are of different bodies."""
    body = np.repeat([0, 1], scene.n_joints)
    mask: Array = (body[:, None] != body).astype(np.float64)
    return mask


def complete_graph(scene: Scene) -> Array:
    """``(N, N)`` ones along bones and between all joints of different bodies."""
    edges = inter_body_mask(scene)
    parent, child = scene.bones.T
    edges[parent, child] = edges[child, parent] = 1
    return edges


def delaunay_graph(scene: Scene) -> Array:
    """``(T, N, N)`` ones along bones and the edges of each frame's Delaunay tetrahedra."""
    edges = np.zeros((*scene.points.shape[:2], scene.points.shape[1]))
    for frame, pose in zip(edges, scene.points, strict=True):
        cells = Delaunay(pose).simplices
        frame[cells[:, :, None], cells[:, None]] = 1
    parent, child = scene.bones.T
    edges[:, parent, child] = edges[:, child, parent] = 1
    points = np.arange(edges.shape[1])
    edges[:, points, points] = 0
    return edges


def _joint_distances(points: Array) -> Array:
    """``(T, N, N)`` metres."""
    squares = np.zeros((len(points), points.shape[1], points.shape[1]))
    for axis in range(3):
        squares += np.square(points[:, :, None, axis] - points[:, None, :, axis])
    distances: Array = np.sqrt(squares, out=squares)
    return distances


def ground_supports(scene: Scene, support: Support) -> NDArray[np.bool_]:
    """Whether a joint supports its body, ``(T, N)``: it is low, near the ground, and slow.

    Feet, and hands and knees where they bear weight.
    """
    heights = scene.points[..., 1]
    level = np.quantile(heights, LOWEST_QUANTILE, axis=0)
    is_low = heights < level + support.height_tolerance
    is_near_ground = level < scene.ground_height + support.max_height
    return is_low & is_near_ground & (_joint_speeds(scene) < support.max_speed)


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


def trunk_joints(scene: Scene) -> list[NDArray[np.intp]]:
    """List the points of each body from its root to the first joints of its limbs.

    A body without limbs has no trunk.
    """
    parent_of = {child: parent for parent, child in scene.bones.tolist()}
    trunks: tuple[set[int], set[int]] = (set(), set())
    for limb_root, _, _ in hinge_joints(scene).tolist():
        joint, trunk = limb_root, trunks[int(limb_root >= scene.n_joints[0])]
        trunk.add(joint)
        while joint in parent_of:
            joint = parent_of[joint]
            trunk.add(joint)
    return [np.array(sorted(trunk), dtype=np.intp) for trunk in trunks]


def trunk_shape_matrices(scene: Scene, weight: float) -> tuple[Array, Array]:
    """Return the positions of trunk joints relative to their trunk's mean, times sqrt(weight).

    Without this term a smaller body folds its hips and shoulders together, as bones that share a
    joint turn freely against each other.

    Returns
    -------
    ``(M, N)``, as a matrix on the points; and ``(M, E)``, as a matrix on the bones, each scaled
    along its own direction
    """
    identity, blocks = np.eye(scene.points.shape[1]), []
    for joints in trunk_joints(scene):
        rows = identity[joints]
        blocks.append(rows - rows.mean(axis=0) if len(joints) else rows)
    relative: Array = np.sqrt(weight) * np.concatenate(blocks)
    return relative, relative @ ancestor_bones(scene)


def ancestor_bones(scene: Scene) -> Array:
    """``(N, E)``: ones where a bone lies between a point and its body's root."""
    bone_of = {child: (row, parent) for row, (parent, child) in enumerate(scene.bones.tolist())}
    ancestors = np.zeros((scene.points.shape[1], len(scene.bones)))
    for point in range(len(ancestors)):
        joint = point
        while joint in bone_of:
            row, joint = bone_of[joint]
            ancestors[point, row] = 1
    return ancestors


def hinge_joints(scene: Scene) -> NDArray[np.intp]:
    """Return the elbows and knees of both bodies, ``(H, 3)`` points (parent, hinge, child).

    Names differ between skeletons, so limbs are identified by structure: a limb begins at a joint
    with a mirror image whose parent has none. Its hinge lies between its two long bones.
    """
    lengths = np.linalg.norm(scene.bone_vectors, axis=-1).mean(axis=0)
    hinges, first_joint, first_bone = [], 0, 0
    for skeleton in scene.skeletons:
        body_lengths = lengths[first_bone : first_bone + len(skeleton.bones)]
        hinges += [first_joint + hinge for hinge in _hinges_of_body(skeleton, body_lengths)]
        first_joint += len(skeleton.joints)
        first_bone += len(skeleton.bones)
    return np.array(hinges, dtype=np.intp).reshape(-1, 3)


def _hinges_of_body(skeleton: Skeleton, lengths: Array) -> list[NDArray[np.intp]]:
    """List (parent, hinge, child) of each limb: the adjacent bones whose shorter one is longest."""
    parents, mirrored = skeleton.parents, {i for pair in skeleton.left_right for i in pair}
    length = dict(zip(skeleton.bones[:, 1].tolist(), lengths.tolist(), strict=True))
    hinges: dict[int, tuple[float, list[int]]] = {}
    limb_of: dict[int, int] = {}
    for joint in skeleton.order[1:]:
        parent = parents[joint]
        if joint in mirrored:
            limb_of[joint] = limb_of.get(parent, joint)
        if parent in limb_of and joint in limb_of:
            limb = limb_of[joint]
            shorter = min(length[parent], length[joint])
            if limb not in hinges or shorter > hinges[limb][0]:
                hinges[limb] = (shorter, [parents[parent], parent, joint])
    return [np.array(chain, dtype=np.intp) for _, chain in hinges.values()]
