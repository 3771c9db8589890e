"""The differences of points that penalties hold: bones to their lengths, pairs apart."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pacmo_core.interaction_mesh.scene import Array, Scene


@dataclass(frozen=True)
class Rows:
    """Differences of two points, as rows of a matrix of -1 and 1; bones come first.

    Parameters
    ----------
    matrix : (1, R, N) or, where pairs change from frame to frame, (T, R, N)
    weights : (R,), penalties
    source : (T, R, 3) metres, the differences in the source
    least : (T, R - E) metres, how far apart the pairs must stay
    """

    matrix: Array
    weights: Array
    source: Array
    least: Array

    @property
    def penalty(self) -> Array:
        """``(T, N, N)`` or ``(1, N, N)``: what the penalties add to the energy's matrix."""
        weighted = self.weights[:, None] * self.matrix
        penalty: Array = self.matrix.transpose(0, 2, 1) @ weighted
        return penalty


def bone_rows(scene: Scene, penalty: float) -> Rows:
    """Hold bones alone."""
    matrix = _differences(scene.bones[None], scene.points.shape[1])
    weights = np.full(len(scene.bones), penalty)
    return Rows(matrix, weights, scene.vectors, np.zeros((len(scene.points), 0)))


def guarded_rows(scene: Scene, bones: Rows, apart: float, n_pairs: int, clearance: float) -> Rows:
    """Hold the closest pairs of every frame apart too, each as far as in the source at most.

    Parameters
    ----------
    apart : penalty
    n_pairs : a frame
    clearance : metres that joints of two bodies keep, where the source does
    """
    pairs = closest_pairs(scene, n_pairs)
    source = np.take_along_axis(scene.points, pairs[..., 1, None], axis=1) - np.take_along_axis(
        scene.points, pairs[..., 0, None], axis=1
    )
    extra = _differences(pairs, scene.points.shape[1])
    held = np.broadcast_to(bones.matrix, (len(extra), *bones.matrix.shape[1:]))
    return Rows(
        matrix=np.concatenate([held, extra], axis=1),
        weights=np.concatenate([bones.weights, np.full(pairs.shape[1], apart)]),
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


def _differences(pairs: NDArray[np.intp], n_points: int) -> Array:
    """``(T, R, N)``: the second point of each pair less the first."""
    everyone = np.arange(n_points)
    ends = (pairs[..., None] == everyone).astype(np.float64)
    difference: Array = ends[..., 1, :] - ends[..., 0, :]
    return difference
