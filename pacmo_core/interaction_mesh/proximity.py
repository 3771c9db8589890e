"""How near the two bodies are: joints that are near or touch, bones, penetration of capsules."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.interaction import closest_points
from pacmo_core.interaction_mesh.body_parts import capsule_radii
from pacmo_core.interaction_mesh.scene import Array, Scene

# Metres by which two capsules of the source may be apart and still meet in a variation.
MAX_GAP = 0.3
FRAMES_PER_BATCH = 64  # bounds memory


def contacts_kept(scene: Scene, points: Array, distance: float, slack: float) -> Array:
    """Return the fraction of contacts of the source that are kept within a slack, ``(V,)``.

    Without contacts all are kept.
    """
    total, count = np.zeros(points.shape[-1]), 0
    for pairs in near_pairs(scene, points, distance):
        total += (pairs.after < distance + slack).sum(axis=0)
        count += len(pairs.frame)
    return total / count if count else np.ones(len(total))


def near_distance_error(scene: Scene, points: Array, distance: float) -> Array:
    """Return the mean change of the distances of near pairs, (V,) metres; zero without any."""
    total, count = np.zeros(points.shape[-1]), 0
    for pairs in near_pairs(scene, points, distance):
        total += np.abs(pairs.after - pairs.before[:, None]).sum(axis=0)
        count += len(pairs.frame)
    return total / max(1, count)


@dataclass(frozen=True)
class NearPairs:
    """Pairs of joints of the two people that are near in the source.

    Parameters
    ----------
    frame, joint_a, joint_b : (P,) frames, and joints of each person
    before : (P,) metres, their distances in the source
    after : (P, V) metres, in motions
    """

    frame: NDArray[np.intp]
    joint_a: NDArray[np.intp]
    joint_b: NDArray[np.intp]
    before: Array
    after: Array


def near_pairs(scene: Scene, points: Array, distance: float) -> Iterator[NearPairs]:
    """Yield the pairs and frames that are within a distance in the source, some frames at a time.

    Parameters
    ----------
    points : (T, N, 3, V) metres
    distance : metres
    """
    n_a = scene.n_joints[0]
    for batch in _batches(len(points)):
        a, b = np.split(scene.points[batch], [n_a], axis=1)
        before = np.linalg.norm(a[:, :, None] - b[:, None], axis=-1)
        frame, i, j = np.nonzero(before < distance)
        vectors = points[batch][frame, i] - points[batch][frame, n_a + j]
        after = np.sqrt(np.einsum("pcv,pcv->pv", vectors, vectors))
        yield NearPairs(batch.start + frame, i, j, before[frame, i, j], after)


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
