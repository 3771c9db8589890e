"""Random motions and features for the tests of metrics."""

import numpy as np

from pacmo_core.metrics.reactions import Reactions


def motions(n, rng, joints=3, shortest=5, longest=12):
    lengths = rng.integers(shortest, longest + 1, size=n)
    return [rng.normal(size=(length, joints, 3)).astype(np.float32) for length in lengths]


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def reactions(n_clips, prefix, rng, channels=2, r=6, further=0):
    """Two people a clip: 2·n_clips samples."""
    bodies = motions(2 * n_clips, rng)
    embedded = unit(rng.normal(size=(2 * n_clips, 4)))
    return Reactions(
        features=rng.normal(size=(2 * n_clips, channels, r)),
        motions=bodies,
        partners=[body + 1 for body in bodies],
        times=[np.arange(len(body)) / 30 for body in bodies],
        clips=[f"{prefix}{i // 2}" for i in range(2 * n_clips)],
        embedded=np.stack([embedded, unit(embedded + 0.1 * rng.normal(size=embedded.shape))]),
        further=rng.normal(size=(further, 2 * n_clips, channels, r)),
    )
