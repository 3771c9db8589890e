"""Fit rotations to joint positions: constant bone lengths, forward and inverse kinematics.

``fit_bones`` finds the nearest motion of a body whose bone lengths are constant. ``aim_bones``
and ``inverse_kinematics`` pose a given tree of rigid joints: bones that leave one joint
keep their angles to each other, so not every pose can be reached; the error is
spread over the body by least squares.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.interaction import Motion, bone_lengths
from pacmo_core.data.skeleton import Skeleton

# Weight that keeps a joint's rotation near its parent's, relative to squared bone length: it only
# determines the twist about a bone, which positions leave undetermined.
TWIST_REGULARISATION = 1e-7
N_ROUNDS = 3  # of alternating between offsets and rotations


@dataclass(frozen=True)
class ConstantBoneMotion:
    """A skeleton of constant bones in motion.

    Parameters
    ----------
    offsets : (J, 3) metres from the parent in the parent's frame; zero for the root
    root : (T, 3) metres, in the world
    rotations : (T, J, 3, 3), each against the parent's; the root's against the world
    """

    offsets: NDArray[np.float64]
    root: NDArray[np.float64]
    rotations: NDArray[np.float64]

    def positions(self, skeleton: Skeleton) -> NDArray[np.float64]:
        """Return ``(T, J, 3)`` metres: joint positions."""
        positions = np.zeros((len(self.root), len(skeleton.joints), 3))
        rotations_world = np.zeros_like(self.rotations)
        for joint in skeleton.order:
            parent = skeleton.parents[joint]
            if parent < 0:
                positions[:, joint], rotations_world[:, joint] = self.root, self.rotations[:, joint]
            else:
                positions[:, joint] = (
                    positions[:, parent] + rotations_world[:, parent] @ self.offsets[joint]
                )
                rotations_world[:, joint] = rotations_world[:, parent] @ self.rotations[:, joint]
        return positions


def fit_bones(motion: Motion, skeleton: Skeleton) -> ConstantBoneMotion:
    """Fit a skeleton of constant bone lengths (the median of each) to joint positions.

    From the root outwards, each joint is rotated so that its children come nearest to their
    positions (Kabsch over all children). The twist of a joint with one child or none follows the
    parent. The rest pose starts from the first frame and is refined by the mean bone directions.

    Parameters
    ----------
    motion : (T, J, 3) float32, metres, y up
    """
    positions = motion.astype(np.float64)
    lengths = np.zeros(len(skeleton.joints))
    lengths[skeleton.bones[:, 1]] = np.median(bone_lengths(motion, skeleton), axis=0)
    offsets = np.zeros((len(lengths), 3))
    for parent, child in skeleton.bones:
        offsets[child] = positions[0, child] - positions[0, parent]
    offsets = _with_lengths(offsets, lengths)
    for _ in range(N_ROUNDS):
        fitted = _fit_rotations(positions, offsets, skeleton)
        offsets = _with_lengths(_mean_offsets(positions, fitted, skeleton), lengths)
    return _fit_rotations(positions, offsets, skeleton)


def _fit_rotations(
    positions: NDArray[np.float64], offsets: NDArray[np.float64], skeleton: Skeleton
) -> ConstantBoneMotion:
    """Fit rotations from the root outwards; errors of bone length do not accumulate."""
    children = _children(skeleton)
    fitted_positions = np.zeros_like(positions)
    rotations_world = np.zeros((*positions.shape, 3))
    local = np.zeros_like(rotations_world)
    for joint in skeleton.order:
        parent = skeleton.parents[joint]
        fitted_positions[:, joint] = positions[:, joint]
        parent_rotation = np.broadcast_to(np.eye(3), rotations_world[:, joint].shape)
        if parent >= 0:
            parent_rotation = rotations_world[:, parent]
            fitted_positions[:, joint] = (
                fitted_positions[:, parent] + parent_rotation @ offsets[joint]
            )
        targets = positions[:, children[joint]] - fitted_positions[:, [joint]]
        local[:, joint] = _kabsch(targets @ parent_rotation, offsets[children[joint]])
        rotations_world[:, joint] = parent_rotation @ local[:, joint]
    return ConstantBoneMotion(offsets, positions[:, skeleton.root], local)


def _kabsch(targets: NDArray[np.float64], offsets: NDArray[np.float64]) -> NDArray[np.float64]:
    """``(T, 3, 3)`` rotations that take offsets ``(n, 3)`` nearest to ``(T, n, 3)`` (Kabsch)."""
    covariance = np.einsum("tni,nj->tij", targets, offsets)
    u, _, right = np.linalg.svd(covariance + TWIST_REGULARISATION * np.eye(3))
    u[..., -1] *= np.linalg.det(u @ right)[:, None]
    rotations: NDArray[np.float64] = u @ right
    return rotations


def _mean_offsets(
    positions: NDArray[np.float64], fitted: ConstantBoneMotion, skeleton: Skeleton
) -> NDArray[np.float64]:
    """Return the mean over time of each bone in the frame of its parent."""
    rotations_world = np.zeros_like(fitted.rotations)
    means = np.zeros_like(fitted.offsets)
    for joint in skeleton.order:
        parent = skeleton.parents[joint]
        rotations_world[:, joint] = fitted.rotations[:, joint]
        if parent >= 0:
            bone = positions[:, joint] - positions[:, parent]
            means[joint] = np.einsum("tij,ti->j", rotations_world[:, parent], bone) / len(positions)
            rotations_world[:, joint] = rotations_world[:, parent] @ rotations_world[:, joint]
    return means


def _with_lengths(
    vectors: NDArray[np.float64], lengths: NDArray[np.float64]
) -> NDArray[np.float64]:
    norms = np.linalg.norm(vectors, axis=-1)
    scales = np.divide(lengths, norms, out=np.zeros_like(norms), where=norms > 0)
    scaled: NDArray[np.float64] = vectors * scales[:, None]
    return scaled


def _children(skeleton: Skeleton) -> list[list[int]]:
    children: list[list[int]] = [[] for _ in skeleton.joints]
    for parent, child in skeleton.bones:
        children[parent].append(int(child))
    return children


Array = NDArray[np.float64]

# Weight that keeps a joint's present rotation, relative to squared bone length: it only determines
# what positions leave undetermined.
ROTATION_REGULARISATION = 1e-6
N_GAUSS_NEWTON_STEPS = 6
DAMPING = 1e-3  # of a rotation, relative to the squared size of the skeleton
FRAMES_PER_BATCH = 128  # bounds memory


def forward_kinematics(
    parents: Sequence[int], root: Array, offsets: Array, local: Array
) -> tuple[Array, Array]:
    """Compute joint positions (T, J, 3) and world rotations (T, J, 3, 3).

    Parameters
    ----------
    parents : each before its children
    root : (T, 3)
    offsets : (T, J, 3) from the parent, in the parent's frame
    local : (T, J, 3, 3), rotations against the parent
    """
    positions, rotations_world = np.zeros_like(offsets), np.zeros_like(local)
    positions[:, 0], rotations_world[:, 0] = root, local[:, 0]
    for joint, parent in enumerate(parents):
        if parent >= 0:
            positions[:, joint] = positions[:, parent] + rotate_vectors(
                rotations_world[:, parent], offsets[:, joint]
            )
            rotations_world[:, joint] = rotations_world[:, parent] @ local[:, joint]
    return positions, rotations_world


def aim_bones(
    parents: Sequence[int], targets: dict[int, Array], offsets: Array, local: Array
) -> tuple[Array, Array]:
    """Rotate joints from the root outwards so that their bones point to the targets (Kabsch).

    Parameters
    ----------
    targets : (T, 3) positions of some joints, the root among them
    local : (T, J, 3, 3), which determine what positions leave undetermined

    Returns
    -------
    root : (T, 3)
    local : (T, J, 3, 3)
    """
    positions, rotations_world, solution = (
        np.zeros_like(offsets),
        np.zeros_like(local),
        np.zeros_like(local),
    )
    for joint, parent in enumerate(parents):
        parent_rotation = rotations_world[:, parent] if parent >= 0 else np.eye(3)[None]
        base = targets[joint] if parent < 0 else positions[:, parent]
        positions[:, joint] = base + (
            rotate_vectors(parent_rotation, offsets[:, joint]) if parent >= 0 else 0
        )
        ends = [c for c, p in enumerate(parents) if p == joint and c in targets]
        directions = [targets[child] - positions[:, joint] for child in ends]
        rotations_world[:, joint] = _kabsch_of_lists(
            directions, [offsets[:, c] for c in ends], parent_rotation @ local[:, joint]
        )
        solution[:, joint] = np.swapaxes(parent_rotation, -1, -2) @ rotations_world[:, joint]
    return targets[0], solution


def inverse_kinematics(
    parents: Sequence[int], targets: dict[int, Array], offsets: Array, initial: tuple[Array, Array]
) -> tuple[Array, Array]:
    """Pose the tree by damped Gauss-Newton steps on the squared distances to the targets.

    Parameters
    ----------
    targets : (T, 3) positions of some joints, the root among them
    offsets : (T, J, 3) from the parent, in the parent's frame
    initial : root and local rotations, as ``aim_bones`` gives them
    """
    root, local = initial[0].copy(), initial[1].copy()
    for first in range(0, len(root), FRAMES_PER_BATCH):
        part = slice(first, first + FRAMES_PER_BATCH)
        batch_targets = {joint: positions[part] for joint, positions in targets.items()}
        for _ in range(N_GAUSS_NEWTON_STEPS):
            _gauss_newton_step(parents, batch_targets, offsets[part], (root[part], local[part]))
    return root, local


def rotate_vectors(frames: Array, vectors: Array) -> Array:
    """``(T, 3)``: vectors given in frames, in the world."""
    solution: Array = (frames @ vectors[..., None])[..., 0]
    return solution


def _gauss_newton_step(
    parents: Sequence[int], targets: dict[int, Array], offsets: Array, pose: tuple[Array, Array]
) -> None:
    """Take one damped Gauss-Newton step, in place."""
    root, local = pose
    positions, rotations_world = forward_kinematics(parents, root, offsets, local)
    inner = sorted(set(parents) - {-1})
    rows = list(targets)
    jacobian = _jacobian(parents, positions, inner, rows)
    residual = np.stack([targets[joint] - positions[:, joint] for joint in rows], axis=1)
    normal = jacobian.swapaxes(1, 2) @ jacobian
    scale = np.square(positions - positions.mean(axis=1, keepdims=True)).sum(axis=-1).mean(axis=1)
    damping = np.concatenate([np.zeros(3), np.full(3 * len(inner), DAMPING)])
    normal += np.eye(len(damping)) * (damping * scale[:, None])[:, None]
    gradient = jacobian.swapaxes(1, 2) @ residual.reshape(len(root), -1, 1)
    solution: Array = np.linalg.solve(normal, gradient)[..., 0].astype(np.float64)
    root += solution[:, :3]
    for index, joint in enumerate(inner):
        rotation = _rotation(solution[:, 3 + 3 * index : 6 + 3 * index])
        parent_rotation = (
            rotations_world[:, parents[joint]] if parents[joint] >= 0 else np.eye(3)[None]
        )
        local[:, joint] = (
            np.swapaxes(parent_rotation, -1, -2) @ rotation @ parent_rotation @ local[:, joint]
        )


def _jacobian(parents: Sequence[int], positions: Array, inner: list[int], rows: list[int]) -> Array:
    """``(T, 3 K, 3 + 3 I)``: derivatives by the root and by rotations of inner joints."""
    jacobian = np.zeros((len(positions), len(rows), 3, 1 + len(inner), 3))
    jacobian[..., 0, :] = np.eye(3)
    for row, joint in enumerate(rows):
        ancestor = parents[joint]
        while ancestor >= 0:
            lever = positions[:, joint] - positions[:, ancestor]
            jacobian[:, row, :, 1 + inner.index(ancestor)] = -_cross(lever)
            ancestor = parents[ancestor]
    return jacobian.reshape(len(positions), 3 * len(rows), -1)


def _cross(vectors: Array) -> Array:
    """``(T, 3, 3)``: the matrix that multiplies by a vector's cross product."""
    x, y, z = vectors.T
    none = np.zeros_like(x)
    return np.array([[none, -z, y], [z, none, -x], [-y, x, none]]).transpose(2, 0, 1)


def _rotation(vectors: Array) -> Array:
    """``(T, 3, 3)``: the rotation about each vector by its length in radians (Rodrigues)."""
    angle = np.linalg.norm(vectors, axis=-1)[:, None, None]
    cross = _cross(vectors / np.maximum(angle[:, 0], np.finfo(np.float64).tiny))
    rotations_world: Array = (
        np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * (cross @ cross)
    )
    return rotations_world


def _kabsch_of_lists(directions: list[Array], bones: list[Array], fallback: Array) -> Array:
    """``(T, 3, 3)``: rotate bones nearest to targets (Kabsch); ``fallback`` without bones."""
    if not bones:
        return fallback
    wanted, offsets = np.stack(directions, axis=1), np.stack(bones, axis=1)
    scale = np.maximum(np.square(offsets).sum(axis=(1, 2)), np.finfo(np.float64).tiny)
    covariance = np.einsum("tni,tnj->tij", wanted, offsets) / scale[:, None, None]
    u, _, right = np.linalg.svd(covariance + ROTATION_REGULARISATION * fallback)
    u[..., -1] *= np.linalg.det(u @ right)[:, None]
    nearest: Array = u @ right
    return nearest
