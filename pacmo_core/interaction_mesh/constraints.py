"""The constraints of a variation: bone lengths, separation and contact of the bodies, the floor.

A row is a difference of points: the vector of a bone, between the closest points of two bones, or
between two joints. Its length has a lower and an upper bound. Bone lengths are exact; the bounds
between the bodies are elastic, as the bodies that lie on each other cannot keep every pair.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pacmo_core.interaction_mesh.body_parts import capsule_radii
from pacmo_core.interaction_mesh.capsules import closest_fractions, segment_differences
from pacmo_core.interaction_mesh.mesh import joint_distances
from pacmo_core.interaction_mesh.scene import Array, Scene
from pacmo_core.interaction_mesh.settings import Attempt, Settings

# Metres: a person's joints that never come closer than this to their lowest have no floor row.
FLOOR_REACH = 0.4
# Metres above the floor at which its penalty has fallen to 1/e.
FLOOR_PENALTY_RANGE = 0.25
# Contacts are closed to this fraction of the contact distance, to be within it.
CONTACT_MARGIN = 0.95
# Slope with which the bound of a pair grows with its distance in the source beyond that. A bound
# that vanished from one frame to the next would cause a jerk.
RELEASE = 3.0


@dataclass(frozen=True)
class Rows:
    """Differences of points whose lengths are bounded.

    Parameters
    ----------
    points : (T, R, 4), of which a difference is the sum times ``coefficients``
    coefficients : (T, R, 4)
    penalties : (T, R), of ADMM
    lower, upper : (T, R) metres, bounds on the length; of bones, their length in the source
    n_bones : the first rows are bones
    elasticity : 0 to 1, fraction of the way to its bounds that the local step takes a row that is
        no bone
    """

    points: NDArray[np.intp]
    coefficients: Array
    penalties: Array
    lower: Array
    upper: Array
    n_bones: int
    elasticity: float

    def differences(self, points: Array) -> Array:
        """Return the differences, ``(T, R, 3, ...)``, of points (T, N, 3, ...)."""
        frames = np.arange(len(points))[:, None]
        total = np.zeros((*self.lower.shape, *points.shape[2:]))
        for end in range(self.points.shape[-1]):
            factors = self.coefficients[..., end]
            total += (
                factors.reshape(*factors.shape, *[1] * (points.ndim - 2))
                * (points[frames, self.points[..., end]])
            )
        return total

    def matrices(self, frames: slice, n_points: int) -> Array:
        """``(F, R, N)``: A of some frames, from points to differences."""
        points, coefficients = self.points[frames], self.coefficients[frames]
        matrix = np.zeros((*points.shape[:2], n_points))
        frame, row = np.indices(points.shape[:2])
        for end in range(points.shape[-1]):
            np.add.at(matrix, (frame, row, points[..., end]), coefficients[..., end])
        return matrix


@dataclass(frozen=True)
class Floor:
    """Lower bounds on the heights of joints, on which ADMM has a penalty near the floor.

    Parameters
    ----------
    joints : (F,)
    penalties : (T, F), of ADMM
    lowest : (F,) metres above the ground, the lowest point of the person in the source
    heights : (T, F) metres above the ground, in the source
    """

    joints: NDArray[np.intp]
    penalties: Array
    lowest: Array
    heights: Array


def bone_rows(scene: Scene, penalties: Array) -> Rows:
    """Return the rows of all bones, with penalties (T, E)."""
    n_frames, n_bones = penalties.shape
    lengths = np.linalg.norm(scene.bone_vectors, axis=-1)
    points = np.concatenate([scene.bones, scene.bones], axis=1)
    coefficients = np.tile([-1.0, 1.0, 0.0, 0.0], (n_bones, 1))
    shape = (n_frames, n_bones, 4)
    return Rows(
        points=np.broadcast_to(points, shape),
        coefficients=np.broadcast_to(coefficients, shape),
        penalties=penalties,
        lower=lengths,
        upper=lengths,
        n_bones=n_bones,
        elasticity=1.0,
    )


def build_rows(scene: Scene, settings: Settings, attempt: Attempt, stiffness: Array) -> Rows:
    """Return the rows of an attempt: bones, and pairs of the two bodies where it has a penalty."""
    bones = bone_rows(scene, attempt.bone_penalty * stiffness)
    if not attempt.pair_penalty:
        return bones
    pairs = [separation_rows(scene, settings.n_pairs), contact_rows(scene, settings)]
    joined = [bones, *pairs]
    penalties = [np.full(p.penalties.shape, attempt.pair_penalty) for p in pairs]
    return Rows(
        points=np.concatenate([rows.points for rows in joined], axis=1),
        coefficients=np.concatenate([rows.coefficients for rows in joined], axis=1),
        penalties=np.concatenate([bones.penalties, *penalties], axis=1),
        lower=np.concatenate([rows.lower for rows in joined], axis=1),
        upper=np.concatenate([rows.upper for rows in joined], axis=1),
        n_bones=bones.n_bones,
        elasticity=settings.pair_stiffness / (settings.pair_stiffness + attempt.pair_penalty),
    )


def separation_rows(scene: Scene, n_pairs: int) -> Rows:
    """Keep the capsules of the bones that are closest to touching apart, or as deep as they were.

    The closest points of two bones stay where they are along the bones in the source.
    """
    n_a = scene.n_bones[0]
    radii = capsule_radii(scene)
    reach = (radii[:n_a, None] + radii[n_a:]).reshape(-1)
    first, second, distances = closest_fractions(scene)
    order = np.argsort(distances - reach, axis=1, kind="stable")[:, :n_pairs]
    bones = np.stack([order // scene.n_bones[1], n_a + order % scene.n_bones[1]], axis=-1)
    fractions = [np.take_along_axis(f, order, axis=1) for f in (first, second)]
    distance = np.take_along_axis(distances, order, axis=1)
    points, coefficients = segment_differences(scene, bones, fractions[0], fractions[1])
    return Rows(
        points=points,
        coefficients=coefficients,
        penalties=np.zeros(distance.shape),
        lower=np.minimum(distance, reach[order]),
        upper=np.full(distance.shape, np.inf),
        n_bones=0,
        elasticity=1.0,
    )


def contact_rows(scene: Scene, settings: Settings) -> Rows:
    """Keep the closest pairs of joints that are in contact within the contact distance."""
    n_a, n_b = scene.n_joints
    distances = joint_distances(scene.points)[:, :n_a, n_a:].reshape(len(scene.points), -1)
    n_pairs = min(settings.n_pairs, int((distances < settings.contact_distance).sum(axis=1).max()))
    order = np.argsort(distances, axis=1, kind="stable")[:, :n_pairs]
    distance = np.take_along_axis(distances, order, axis=1)
    ends = np.stack([order // n_b, n_a + order % n_b], axis=-1)
    limit = CONTACT_MARGIN * settings.contact_distance
    return Rows(
        points=np.concatenate([ends, ends], axis=-1),
        coefficients=np.broadcast_to([-1.0, 1.0, 0.0, 0.0], (*distance.shape, 4)),
        penalties=np.zeros(distance.shape),
        lower=np.zeros(distance.shape),
        upper=limit + RELEASE * (distance - settings.contact_distance).clip(min=0),
        n_bones=0,
        elasticity=1.0,
    )


def build_floor(scene: Scene, penalty: float) -> Floor:
    """Keep joints above the lowest point of their person in the source."""
    heights = scene.points[..., 1]
    lowest = scene.levels.lowest
    joints = np.flatnonzero(heights.min(axis=0) < lowest + FLOOR_REACH)
    above = heights[:, joints] - lowest[joints]
    return Floor(
        joints=joints,
        penalties=penalty * np.exp(-((above / FLOOR_PENALTY_RANGE) ** 4)),
        lowest=lowest[joints] - scene.ground_height,
        heights=heights[:, joints] - scene.ground_height,
    )
