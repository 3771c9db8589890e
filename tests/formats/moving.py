"""A body of constant bones that moves, by forward kinematics written out joint by joint."""

import numpy as np
from scipy.spatial.transform import Rotation

from pacmo_core.data.skeleton import Skeleton


def moving(skeleton: Skeleton, seed: int, n_frames: int = 8) -> np.ndarray:
    """Turn every joint of a body of constant bones at random, smoothly, about all axes."""
    random = np.random.default_rng(seed)
    offsets = random.normal(scale=0.3, size=(len(skeleton.joints), 3))
    rates = random.normal(scale=3, size=(len(skeleton.joints), 3))
    start = Rotation.random(len(skeleton.joints), rng=random)
    places = np.zeros((n_frames, len(skeleton.joints), 3))
    for t in range(n_frames):
        turns: dict[int, Rotation] = {}
        for joint in skeleton.order:
            turn = start[joint] * Rotation.from_rotvec(rates[joint] * t / n_frames)
            parent = skeleton.parents[joint]
            if parent < 0:
                places[t, joint] = [0.1 * t, 1, -0.2 * t]
                turns[joint] = turn
            else:
                places[t, joint] = places[t, parent] + turns[parent].apply(offsets[joint])
                turns[joint] = turns[parent] * turn
    return places.astype(np.float32)
