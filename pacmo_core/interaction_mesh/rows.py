"""The differences of points that penalties hold: bones to their lengths, pairs apart."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pacmo_core.interaction_mesh.scene import Array, Scene


@dataclass(frozen=True)
class Rows:
    """Differences of two points; bones come first.

    Parameters
    ----------
    pairs : (T, R, 2), the second point less the first
    weights : (T, R), penalties
    source : (T, R, 3) metres, the differences in the source
    least : (T, R - E) metres, how far apart the pairs must stay
    """

    pairs: NDArray[np.intp]
    weights: Array
    source: Array
    least: Array


def bone_rows(scene: Scene, weights: Array) -> Rows:
    """Hold bones alone, with weights (T, E)."""
    n_frames = len(scene.points)
    pairs = np.broadcast_to(scene.bones, (n_frames, *scene.bones.shape))
    return Rows(pairs, weights, scene.vectors, np.zeros((n_frames, 0)))


def guarded_rows(scene: Scene, bones: Rows, apart: float, n_pairs: int, clearance: float) -> Rows:
    """Hold the closest pairs of every frame apart too, each as far as in the source at most.

    Parameters
    ----------
    apart : penalty
    n_pairs : a frame
    clearance : metres that joints of two bodies keep, where the source does
    """
    pairs = closest_pairs(scene, n_pairs)
    first, second = (
        np.take_along_axis(scene.points, pairs[..., end, None], axis=1) for end in (0, 1)
    )
    source = second - first
    return Rows(
        pairs=np.concatenate([bones.pairs, pairs], axis=1),
        weights=np.concatenate([bones.weights, np.full(pairs.shape[:2], apart)], axis=1),
        source=np.concatenate([bones.source, source], axis=1),
        least=np.linalg.norm(source, axis=-1).clip(max=clearance),
    )


def closest_pairs(scene: Scene, n_pairs: int) -> NDArray[np.intp]:
    """``(T, P, 2)``: the pairs of points, one of either body, that are closest in each frame."""
    n_a, n_b = scene.n_joints
    a, b = scene.points[:, :n_a, None], scene.points[:, None, n_a:]
    distances = np.linalg.norm(a - b, axis=-1).reshape(len(a), -1)
    found = np.argsort(distances, axis=1, kind="stable")[:, :n_pairs]
    return np.stack([found // n_b, n_a + found % n_b], axis=-1)


def differences(pairs: NDArray[np.intp], n_points: int) -> Array:
    """``(..., R, N)``: the matrix of -1 and 1 that takes points to their differences."""
    everyone = np.arange(n_points)
    first, second = ((pairs[..., end, None] == everyone).astype(np.float64) for end in (0, 1))
    difference: Array = second - first
    return difference
