"""What both bodies have in common: when both grow, the scene grows, and contact stays contact."""

import numpy as np

from pacmo_core.interaction_mesh.scene import Array, Scene


def scene_scale(scene: Scene, scales: Array) -> Array:
    """``(V,)``: the part of the scales that is common to both bodies.

    It is the middle one of 1 and the two bodies' own mean scales, by length of bone: 1 where only
    one body changes or where they change in opposite ways, the scale where both have the same.
    """
    lengths = np.linalg.norm(scene.vectors, axis=-1).mean(axis=0)
    n_a = scene.n_bones[0]
    means = [
        np.average(scales[:, part], axis=1, weights=lengths[part])
        for part in (slice(None, n_a), slice(n_a, None))
    ]
    common: Array = np.median([np.ones(len(scales)), *means], axis=0)
    return common


def scale_scene(scene: Scene, points: Array, whole: Array) -> Array:
    """``(V, T, N, 3)`` metres: scale about the scene's middle on the ground.

    Parameters
    ----------
    points : (V, T, N, 3) metres
    whole : (V,)
    """
    middle = scene.points.mean(axis=(0, 1))
    middle[1] = scene.ground
    scaled: Array = middle + whole[:, None, None, None] * (points - middle)
    return scaled
