"""The motion of a body of constant bones that comes nearest to joints that moved freely."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.interaction import Motion, bone_lengths
from pacmo_core.data.skeleton import Skeleton

# Weight of keeping a joint's rotation near its parent's, beside bones of unit length squared:
# decides only what the bones leave open, the twist about a single child.
STAY = 1e-7
ROUNDS = 3  # of fitting offsets to rotations and rotations to offsets


@dataclass(frozen=True)
class Fitted:
    """A body of constant bones in motion.

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
        """``(T, J, 3)`` metres: where the joints are."""
        places = np.zeros((len(self.root), len(skeleton.joints), 3))
        turns = np.zeros_like(self.rotations)
        for joint in skeleton.order:
            parent = skeleton.parents[joint]
            if parent < 0:
                places[:, joint], turns[:, joint] = self.root, self.rotations[:, joint]
            else:
                places[:, joint] = places[:, parent] + turns[:, parent] @ self.offsets[joint]
                turns[:, joint] = turns[:, parent] @ self.rotations[:, joint]
        return places


def fit_bones(motion: Motion, skeleton: Skeleton) -> Fitted:
    """Give every bone its median length, and every joint the rotation that its children ask for.

    From the root on, each joint is turned so that its children come nearest to where they were; a
    joint of several children turns as they do on the whole. What that leaves open, the twist of a
    joint with one child or none, stays with the parent. The pose of rest is the first frame's,
    averaged with the others as far as they are turns of it.

    Parameters
    ----------
    motion : (T, J, 3) float32, metres, y up
    """
    places = motion.astype(np.float64)
    lengths = np.zeros(len(skeleton.joints))
    lengths[skeleton.bones[:, 1]] = np.median(bone_lengths(motion, skeleton), axis=0)
    offsets = np.zeros((len(lengths), 3))
    for parent, child in skeleton.bones:
        offsets[child] = places[0, child] - places[0, parent]
    offsets = _scaled(offsets, lengths)
    for _ in range(ROUNDS):
        fitted = _turned(places, offsets, skeleton)
        offsets = _scaled(_mean_offsets(places, fitted, skeleton), lengths)
    return _turned(places, offsets, skeleton)


def _turned(places: NDArray[np.float64], offsets: NDArray[np.float64], body: Skeleton) -> Fitted:
    """Choose rotations from the root on; what is too long or short is not handed down."""
    children = _children(body)
    reached = np.zeros_like(places)
    turns = np.zeros((*places.shape, 3))
    local = np.zeros_like(turns)
    for joint in body.order:
        parent = body.parents[joint]
        reached[:, joint] = places[:, joint]
        above = np.broadcast_to(np.eye(3), turns[:, joint].shape)
        if parent >= 0:
            above = turns[:, parent]
            reached[:, joint] = reached[:, parent] + above @ offsets[joint]
        wanted = places[:, children[joint]] - reached[:, [joint]]
        local[:, joint] = _nearest(wanted @ above, offsets[children[joint]])
        turns[:, joint] = above @ local[:, joint]
    return Fitted(offsets, places[:, body.root], local)


def _nearest(wanted: NDArray[np.float64], offsets: NDArray[np.float64]) -> NDArray[np.float64]:
    """``(T, 3, 3)`` rotations that take offsets ``(n, 3)`` nearest to ``(T, n, 3)`` (Kabsch)."""
    together = np.einsum("tni,nj->tij", wanted, offsets)
    left, _, right = np.linalg.svd(together + STAY * np.eye(3))
    left[..., -1] *= np.linalg.det(left @ right)[:, None]
    rotations: NDArray[np.float64] = left @ right
    return rotations


def _mean_offsets(
    places: NDArray[np.float64], fitted: Fitted, body: Skeleton
) -> NDArray[np.float64]:
    """Average over time each bone as its parent's frame sees it."""
    turns = np.zeros_like(fitted.rotations)
    means = np.zeros_like(fitted.offsets)
    for joint in body.order:
        parent = body.parents[joint]
        turns[:, joint] = fitted.rotations[:, joint]
        if parent >= 0:
            bone = places[:, joint] - places[:, parent]
            means[joint] = np.einsum("tij,ti->j", turns[:, parent], bone) / len(places)
            turns[:, joint] = turns[:, parent] @ turns[:, joint]
    return means


def _scaled(vectors: NDArray[np.float64], lengths: NDArray[np.float64]) -> NDArray[np.float64]:
    norms = np.linalg.norm(vectors, axis=-1)
    scales = np.divide(lengths, norms, out=np.zeros_like(norms), where=norms > 0)
    scaled: NDArray[np.float64] = vectors * scales[:, None]
    return scaled


def _children(body: Skeleton) -> list[list[int]]:
    children: list[list[int]] = [[] for _ in body.joints]
    for parent, child in body.bones:
        children[parent].append(int(child))
    return children
