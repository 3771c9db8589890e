"""Whether a body is still one: right lengths may stand at angles that no trunk allows."""

import numpy as np
from numpy.typing import NDArray

from pacmo_core.augmentation.bodies import Scales
from pacmo_core.augmentation.segments import segments
from pacmo_core.data.interaction import Motion
from pacmo_core.data.skeleton import Skeleton


def trunk_change(source: Motion, varied: Motion, skeleton: Skeleton, scales: Scales) -> float:
    """Give the share by which two joints of the trunk are nearer or farther than they should be.

    Should be: as if every bone were scaled along its own direction. Of each pair of joints the
    median over time counts, and of all pairs the worst.

    Parameters
    ----------
    source, varied : (T, J, 3) metres, of one person
    scales : (E,)
    """
    joints = _trunk(skeleton)
    if len(joints) < 2:
        return 0.0
    wanted = _distances(_scaled(source.astype(np.float64), skeleton, scales)[:, joints])
    found = _distances(varied.astype(np.float64)[:, joints])
    return float(np.abs(np.median(found / wanted, axis=0) - 1).max())


def _trunk(skeleton: Skeleton) -> list[int]:
    """List the root and the joints at which bones of the trunk end, but for the head's."""
    named = zip(skeleton.bones[:, 1].tolist(), segments(skeleton), strict=True)
    above = {"head", "neck", "upperneck", "lowerneck"}
    return [
        skeleton.root,
        *(joint for joint, s in named if s.part == "trunk" and not above & set(s.name.split("_"))),
    ]


def _scaled(motion: NDArray[np.float64], skeleton: Skeleton, scales: Scales) -> NDArray[np.float64]:
    """``(T, J, 3)``: each bone longer along its own direction, from the root outwards."""
    scale_of = dict(zip(skeleton.bones[:, 1].tolist(), scales.tolist(), strict=True))
    places = motion.copy()
    for joint in skeleton.order[1:]:
        parent = skeleton.parents[joint]
        bone = motion[:, joint] - motion[:, parent]
        places[:, joint] = places[:, parent] + scale_of[joint] * bone
    return places


def _distances(places: NDArray[np.float64]) -> NDArray[np.float64]:
    """``(T, P)`` metres: of each pair of joints."""
    one, other = np.triu_indices(places.shape[1], k=1)
    distances: NDArray[np.float64] = np.linalg.norm(places[:, one] - places[:, other], axis=-1)
    return np.maximum(distances, np.finfo(np.float32).tiny)
