"""The motion of constant bone lengths that is nearest to given joint positions."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.interaction import Motion, bone_lengths
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.formats.inverse_kinematics import inverse_kinematics

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


def reach_targets(
    fitted: ConstantBoneMotion,
    motion: Motion,
    weights: NDArray[np.float64],
    skeleton: Skeleton,
) -> ConstantBoneMotion:
    """Pose the bones of a fit anew, by least squares of the weighted distances to the motion.

    Parameters
    ----------
    motion : (T, J, 3) float32, metres
    weights : (T, J), of the squared distances
    """
    order = list(skeleton.order)
    parents = [order.index(p) if (p := skeleton.parents[joint]) >= 0 else -1 for joint in order]
    targets = {row: motion[:, joint].astype(np.float64) for row, joint in enumerate(order)}
    offsets = np.repeat(fitted.offsets[None, order], len(motion), axis=0)
    initial = (fitted.root, fitted.rotations[:, order])
    root, local = inverse_kinematics(parents, targets, weights[:, order], offsets, initial)
    return replace(fitted, root=root, rotations=local[:, np.argsort(order)])


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
