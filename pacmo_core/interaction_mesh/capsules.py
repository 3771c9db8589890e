"""Distances between the bones of the two bodies as line segments, and penetration of capsules."""

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.interaction import closest_points
from pacmo_core.interaction_mesh.body_parts import capsule_radii
from pacmo_core.interaction_mesh.scene import Array, Scene

# Metres by which two capsules of the source may be apart and still meet in a variation.
MAX_GAP = 0.3
FRAMES_PER_BATCH = 64  # bounds memory


def closest_fractions(scene: Scene) -> tuple[Array, Array, Array]:
    """Return the fractions along both bones and the distance, (T, E_a E_b) each, of all pairs."""
    begins, vectors = scene.points[:, scene.bones[:, 0]], scene.bone_vectors
    n_a = scene.n_bones[0]
    parts = [
        closest_points(
            (begins[frames, :n_a, None], vectors[frames, :n_a, None]),
            (begins[frames, None, n_a:], vectors[frames, None, n_a:]),
        )
        for frames in _batches(len(begins))
    ]
    first, second, distances = (
        np.concatenate(values).reshape(len(begins), -1) for values in zip(*parts, strict=True)
    )
    return first, second, distances


def segment_differences(
    scene: Scene, bones: NDArray[np.intp], first: Array, second: Array
) -> tuple[NDArray[np.intp], Array]:
    """Return the four points of each difference of two points on bones, and their coefficients.

    Parameters
    ----------
    bones : (T, P, 2)
    first, second : (T, P), fractions along them

    Returns
    -------
    (T, P, 4) points and coefficients
    """
    points = scene.bones[bones].reshape(*bones.shape[:2], 4)
    coefficients = np.stack([first - 1, -first, 1 - second, second], axis=-1)
    return points, coefficients


def penetration_depths(scene: Scene) -> Array:
    """Return how deep the bones of all pairs are in each other, negative where they are apart.

    Returns
    -------
    (T, E_a E_b) metres
    """
    depths: Array = _reach(scene) - closest_fractions(scene)[2]
    return depths


def _reach(scene: Scene) -> Array:
    """``(E_a E_b,)`` metres: the distance within which two bones are in each other."""
    n_a, radii = scene.n_bones[0], capsule_radii(scene)
    reach: Array = (radii[:n_a, None] + radii[n_a:]).reshape(-1)
    return reach


def capsule_penetration(scene: Scene, points: Array) -> Array:
    """Return by how much the capsules of the two bodies are deeper in each other than the source's.

    The largest over frames of the depth of the deepest pair of bones, less that of the source's
    deepest pair in the same frame; zero where no frame is deeper.

    Parameters
    ----------
    points : (T, N, 3, V) metres

    Returns
    -------
    (V,) metres
    """
    n_a, reach, source = scene.n_bones[0], _reach(scene), penetration_depths(scene)
    largest = np.zeros(points.shape[-1])
    for frames in _batches(len(points)):
        frame, pair = np.nonzero(source[frames] > -MAX_GAP)
        if not len(frame):
            continue
        before = source[frames].max(axis=1).clip(min=0)
        a, b = pair // scene.n_bones[1], n_a + pair % scene.n_bones[1]
        moved = points[frames]
        ends = [_bone(scene, moved, frame, bone) for bone in (a, b)]
        _, _, after = closest_points(ends[0], ends[1])
        depth = reach[pair, None] - after
        first_of_frame = np.flatnonzero(np.diff(frame, prepend=-1))
        deepest = np.maximum.reduceat(depth, first_of_frame, axis=0)
        excess = deepest.clip(min=0) - before[frame[first_of_frame], None]
        largest = np.maximum(largest, excess.max(axis=0))
    return largest


def _bone(
    scene: Scene, points: Array, frame: NDArray[np.intp], bone: NDArray[np.intp]
) -> tuple[Array, Array]:
    """Return beginning and vector of bones, (P, V, 3)."""
    parent, child = scene.bones[bone].T
    begin = points[frame, parent].transpose(0, 2, 1)
    return begin, points[frame, child].transpose(0, 2, 1) - begin


def _batches(n_frames: int) -> list[slice]:
    starts = range(0, n_frames, FRAMES_PER_BATCH)
    return [slice(start, start + FRAMES_PER_BATCH) for start in starts]
