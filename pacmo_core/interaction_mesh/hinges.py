"""Elbows and knees, and whether they still bend the way they did."""

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.interaction_mesh.scene import Array, Scene

# A limb this straight, by the sine of its bend, has no side to which it bends.
STRAIGHT = 0.25


def hinges(scene: Scene) -> NDArray[np.intp]:
    """``(H, 3)`` points (parent, hinge, child): the middle of every arm and leg of both bodies.

    Names differ from set to set, so limbs are found by shape: what hangs on a joint that has a
    mirror image, where its parent has none. The hinge lies between the limb's two long bones.
    """
    lengths = np.linalg.norm(scene.vectors, axis=-1).mean(axis=0)
    found, first_joint, first_bone = [], 0, 0
    for skeleton in scene.skeletons:
        own = lengths[first_bone : first_bone + len(skeleton.bones)]
        found += [first_joint + hinge for hinge in _of_body(skeleton, own)]
        first_joint += len(skeleton.joints)
        first_bone += len(skeleton.bones)
    return np.array(found, dtype=np.intp).reshape(-1, 3)


def flips(scene: Scene, points: Array) -> Array:
    """``(V,)``: of frames in which a hinge is bent before and after, those where it bends back.

    Parameters
    ----------
    points : (T, N, 3, V) metres
    """
    chain = hinges(scene)
    if not len(chain):
        return np.zeros(points.shape[-1])
    before, was_bent = _bend(scene.points[..., None], chain)
    after, is_bent = _bend(points, chain)
    back = was_bent & is_bent & ((before * after).sum(axis=2) < 0)
    share: Array = back.any(axis=1).mean(axis=0)
    return share


def _of_body(skeleton: Skeleton, lengths: Array) -> list[NDArray[np.intp]]:
    parents, mirrored = skeleton.parents, {i for pair in skeleton.left_right for i in pair}
    length = dict(zip(skeleton.bones[:, 1].tolist(), lengths.tolist(), strict=True))
    found: dict[int, tuple[float, list[int]]] = {}
    limb_of: dict[int, int] = {}
    for joint in skeleton.order[1:]:
        parent = parents[joint]
        if joint in mirrored:
            limb_of[joint] = limb_of.get(parent, joint)
        if parent in limb_of and joint in limb_of:
            limb = limb_of[joint]
            shorter = min(length[parent], length[joint])
            if limb not in found or shorter > found[limb][0]:
                found[limb] = (shorter, [parents[parent], parent, joint])
    return [np.array(chain, dtype=np.intp) for _, chain in found.values()]


def _bend(points: Array, chain: NDArray[np.intp]) -> tuple[Array, NDArray[np.bool_]]:
    """Give the normal of the plane in which each hinge bends, and whether it bends at all."""
    first, middle, last = (points[:, chain[:, end]] for end in range(3))
    upper, lower = middle - first, last - middle
    normal = np.cross(upper, lower, axis=2)
    lengths = (np.linalg.norm(part, axis=2) for part in (upper, lower, normal))
    long, other, bent = lengths
    return normal, bent > STRAIGHT * long * other
