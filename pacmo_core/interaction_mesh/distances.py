"""What became of the distances between the two bodies."""

from dataclasses import dataclass

import numpy as np

from pacmo_core.interaction_mesh.scene import Array, Scene, Single
from pacmo_core.interaction_mesh.settings import Settings


@dataclass(frozen=True)
class Distances:
    """Figures of V motions, (V,) each.

    Parameters
    ----------
    near : metres, by how much pairs of joints differ from the source that are near in it
    far : the same of all others
    kept : of pairs that touch in the source, the share that still does
    penetration : metres that joints come closer than in the source, within the clearance, at worst
    """

    near: Array
    far: Array
    kept: Array
    penetration: Array


def distances_of(scene: Scene, settings: Settings, points: Array) -> Distances:
    """Compare the motions (V, T, N, 3), metres, with the source.

    Where no pair is near, or none touches, nothing is lost: 0 and 1.
    """
    before = _between(scene, scene.points)
    near, touching = before < settings.near, before < settings.touching
    least = before.clip(max=settings.clearance)
    rows = []
    for motion in points:
        after = _between(scene, motion)
        error = np.abs(after - before)
        rows.append(
            (
                _mean(error[near]),
                _mean(error[~near]),
                _mean(after[touching] < settings.touching + settings.slack, empty=1),
                max(0.0, float((least - after).max())),
            )
        )
    return Distances(*np.array(rows, dtype=np.float64).reshape(-1, 4).T)


def _between(scene: Scene, motion: Array) -> Single:
    """``(T, J_a, J_b)`` float32 metres, from squares: one product of matrices a frame."""
    # About the middle of the frame, lest a common offset swallow the digits of the products.
    centred = (motion - motion.mean(axis=1, keepdims=True)).astype(np.float32)
    a, b = np.split(centred, [scene.n_joints[0]], axis=1)
    squared = a @ b.transpose(0, 2, 1)
    squared *= -2
    squared += np.square(a).sum(axis=-1)[..., None]
    squared += np.square(b).sum(axis=-1)[:, None]
    distances: Single = np.sqrt(np.maximum(squared, 0, out=squared), out=squared)
    return distances


def _mean(values: np.ndarray, empty: float = 0) -> float:
    return float(values.mean()) if values.size else empty
