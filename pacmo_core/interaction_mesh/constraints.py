"""The constraints of a variation: bones, angles, separation and contact of the bodies, the floor.

A row is a difference of points: the vector of a bone, between the outer ends of two bones that
meet, between the closest points of two bones, or between two joints. Its length has a lower and an
upper bound. Bounds of a body are exact; those between the bodies are elastic, as bodies that lie on
each other cannot keep every pair.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pacmo_core.interaction_mesh.body_parts import (
    NECK,
    RIGID,
    SPINE,
    capsule_radii,
    hinges,
    trunk_bends,
)
from pacmo_core.interaction_mesh.mesh import joint_distances
from pacmo_core.interaction_mesh.proximity import closest_fractions, segment_differences
from pacmo_core.interaction_mesh.scene import Array, Scene
from pacmo_core.interaction_mesh.settings import Attempt, Settings

# Metres: a person's joints that never come closer than this to their lowest have no floor row.
FLOOR_REACH = 0.4
# Metres above the floor at which its penalty has fallen to 1/e.
FLOOR_PENALTY_RANGE = 0.25
# Degrees by which all joints of a spine, or of a neck, may bend more than in the source, together.
MAX_WHOLE_BEND = {SPINE: 50, NECK: 25}
# Degrees between a knee or elbow and its largest bend, at which the penalty has fallen to 1/e: a
# penalty on a straight limb would only slow the convergence of the body.
HINGE_PENALTY_RANGE = 60
# Metres between two bodies' bones, or beyond the contact distance, at which the penalty of a pair
# has fallen to 1/e.
PAIR_PENALTY_RANGE = 0.2
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
    elasticity : (T, R), 0 to 1, fraction of the way to its bounds that the local step takes a row
    n_body_rows : the first rows are bones and angles, those after them are between the bodies
    """

    points: NDArray[np.intp]
    coefficients: Array
    penalties: Array
    lower: Array
    upper: Array
    elasticity: Array
    n_body_rows: int

    def differences(self, points: Array, first_row: int = 0) -> Array:
        """Return the differences, ``(T, R, 3, ...)``, of points (T, N, 3, ...).

        Parameters
        ----------
        first_row : of those that are returned
        """
        frames = np.arange(len(points))[:, None]
        total = np.zeros((*self.lower[:, first_row:].shape, *points.shape[2:]))
        for end in range(self.points.shape[-1]):
            factors = self.coefficients[:, first_row:, end]
            total += (
                factors.reshape(*factors.shape, *[1] * (points.ndim - 2))
                * (points[frames, self.points[:, first_row:, end]])
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
        elasticity=np.ones(penalties.shape),
        n_body_rows=n_bones,
    )


def build_rows(scene: Scene, settings: Settings, attempt: Attempt, stiffness: Array) -> Rows:
    """Return the rows of an attempt: bones alone, or angles and pairs of the two bodies too."""
    penalties = attempt.bone_penalty * stiffness
    rows = [bone_rows(scene, penalties)]
    if attempt.pair_penalty:
        rows += [
            angle_rows(scene, penalties, angle_bounds(scene, settings)),
            separation_rows(scene, settings, attempt.pair_penalty),
            contact_rows(scene, settings, attempt.pair_penalty),
        ]
    return Rows(
        points=np.concatenate([part.points for part in rows], axis=1),
        coefficients=np.concatenate([part.coefficients for part in rows], axis=1),
        penalties=np.concatenate([part.penalties for part in rows], axis=1),
        lower=np.concatenate([part.lower for part in rows], axis=1),
        upper=np.concatenate([part.upper for part in rows], axis=1),
        elasticity=np.concatenate([part.elasticity for part in rows], axis=1),
        n_body_rows=sum(part.n_body_rows for part in rows),
    )


@dataclass(frozen=True)
class AngleBounds:
    """Lower bounds on the angles between two bones that meet.

    Parameters
    ----------
    pairs : (S, 2), the two bones
    least : (T, S) radians
    closeness : (T, S), 0 to 1, factor on the penalty, which falls with the angle above its bound
    """

    pairs: NDArray[np.intp]
    least: Array
    closeness: Array


def angle_bounds(scene: Scene, settings: Settings) -> AngleBounds:
    """Bound the angles of the spine, and of knees and elbows; for pelvis and chest, ``RigidParts``.

    A joint of the spine or neck bends by at most ``max_spine_bend``
    more than in the source, and where a rig has many, all of them by ``MAX_WHOLE_BEND``, shared
    evenly: so that hips and knees give, and the back does not fold. A knee or elbow bends by at
    most ``max_hinge_bend``, or as far as in that frame of the source: limbs that fold completely
    come out on the other side.
    """
    trunk, kinds = trunk_bends(scene)
    trunk, kinds = trunk[kinds != RIGID], kinds[kinds != RIGID]
    limbs, _ = hinges(scene)
    trunk_angles, limb_angles = _angles(scene, trunk), _angles(scene, limbs)
    ranges = np.radians(_bend_ranges(scene, trunk, kinds, settings))
    least = np.minimum(limb_angles, np.pi - np.radians(settings.max_hinge_bend))
    above = (limb_angles - least) / np.radians(HINGE_PENALTY_RANGE)
    return AngleBounds(
        pairs=np.concatenate([trunk, limbs]),
        least=np.concatenate([(trunk_angles - ranges).clip(min=0), least], axis=1),
        closeness=np.concatenate([np.ones(trunk_angles.shape), np.exp(-(above**4))], axis=1),
    )


def _bend_ranges(
    scene: Scene, pairs: NDArray[np.intp], kinds: NDArray[np.str_], settings: Settings
) -> Array:
    """``(S,)`` degrees by which each pair of bones of a trunk may bend, by its kind."""
    ranges = np.zeros(len(pairs))
    joints = scene.bones[pairs[:, 0], 1]
    is_first = joints < scene.n_joints[0]
    for kind, most in MAX_WHOLE_BEND.items():
        for of_person in (is_first, ~is_first):
            rows = of_person & (kinds == kind)
            n_joints = len(np.unique(joints[rows]))
            ranges[rows] = min(settings.max_spine_bend, most / max(n_joints, 1))
    return ranges


def angle_rows(scene: Scene, penalties: Array, bounds: AngleBounds) -> Rows:
    """Keep the angles between bones within their bounds.

    A row connects the outer ends of two bones that meet. It allows rotations, of which the terms of
    the energy are linear approximations: without it a trunk that the other body compresses kinks at
    one joint.

    Parameters
    ----------
    penalties : (T, E), of the bones
    """
    lower = _end_distances(scene, bounds, np.ones(len(scene.bones)))
    ends = np.stack(_outer_ends(scene, bounds.pairs), axis=-1)
    shape = (*lower.shape, 4)
    return Rows(
        points=np.broadcast_to(np.concatenate([ends, ends], axis=1), shape),
        coefficients=np.broadcast_to([-1.0, 1.0, 0.0, 0.0], shape),
        penalties=penalties[:, bounds.pairs].min(axis=-1) * bounds.closeness,
        lower=lower,
        upper=np.full(lower.shape, np.inf),
        elasticity=np.ones(lower.shape),
        n_body_rows=len(bounds.pairs),
    )


def angle_scales(scene: Scene, scales: Array, bounds: AngleBounds) -> Array:
    """Return the factor on the bounds of every row of ``angle_rows``, (S, V).

    The least over frames, with which the bound can be met in every frame where the two bones grow
    differently.

    Parameters
    ----------
    scales : (E, V)
    """
    tiny = np.finfo(np.float32).tiny
    before = _end_distances(scene, bounds, np.ones(len(scales))).clip(min=tiny)
    ratios = [_end_distances(scene, bounds, body) / before for body in scales.T]
    stacked: Array = np.stack([ratio.min(axis=0) for ratio in ratios], axis=-1)
    return stacked


def _end_distances(scene: Scene, bounds: AngleBounds, scales: Array) -> Array:
    """Return the distances of the outer ends of two bones at the bounds on their angles, (T, S).

    Parameters
    ----------
    scales : (E,)
    """
    lengths = np.linalg.norm(scene.bone_vectors, axis=-1) * scales
    first, second = (lengths[:, bones] for bones in bounds.pairs.T)
    squared = first**2 + second**2 - 2 * first * second * np.cos(bounds.least)
    distances: Array = np.sqrt(squared.clip(min=0))
    return distances


def _angles(scene: Scene, pairs: NDArray[np.intp]) -> Array:
    """Return the angles between bones in the source, (T, S) radians; of a straight limb, pi."""
    sides = _sides(scene, pairs)
    lengths = [np.linalg.norm(side, axis=-1) for side in sides]
    cosines = np.einsum("tsc,tsc->ts", *sides) / (lengths[0] * lengths[1])
    angles: Array = np.arccos(cosines.clip(-1, 1))
    return angles


def _is_chain(scene: Scene, pairs: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Whether the first bone of a pair ends where the second begins; else both begin there."""
    same: NDArray[np.bool_] = scene.bones[pairs[:, 0], 1] == scene.bones[pairs[:, 1], 0]
    return same


def _sides(scene: Scene, pairs: NDArray[np.intp]) -> tuple[Array, Array]:
    """Return the vectors from the joint of each pair of bones to their outer ends, (T, S, 3)."""
    signs = np.where(_is_chain(scene, pairs), -1.0, 1.0)
    return scene.bone_vectors[:, pairs[:, 0]] * signs[:, None], scene.bone_vectors[:, pairs[:, 1]]


def _outer_ends(scene: Scene, pairs: NDArray[np.intp]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    begins, ends = scene.bones.T
    first = np.where(_is_chain(scene, pairs), begins[pairs[:, 0]], ends[pairs[:, 0]])
    return first, ends[pairs[:, 1]]


def separation_rows(scene: Scene, settings: Settings, penalty: float) -> Rows:
    """Keep the capsules of the bones that are closest to touching apart, or as deep as they were.

    The closest points of two bones stay where they are along the bones in the source.
    """
    n_a = scene.n_bones[0]
    radii = capsule_radii(scene)
    reach = (radii[:n_a, None] + radii[n_a:]).reshape(-1)
    first, second, distances = closest_fractions(scene)
    order = np.argsort(distances - reach, axis=1, kind="stable")[:, : settings.n_pairs]
    bones = np.stack([order // scene.n_bones[1], n_a + order % scene.n_bones[1]], axis=-1)
    fractions = [np.take_along_axis(f, order, axis=1) for f in (first, second)]
    distance = np.take_along_axis(distances, order, axis=1)
    points, coefficients = segment_differences(scene, bones, fractions[0], fractions[1])
    penalties = _pair_penalties(penalty, distance - reach[order])
    return Rows(
        points=points,
        coefficients=coefficients,
        penalties=penalties,
        lower=np.minimum(distance, reach[order]),
        upper=np.full(distance.shape, np.inf),
        elasticity=_elasticity(settings.separation_stiffness, penalties),
        n_body_rows=0,
    )


def contact_rows(scene: Scene, settings: Settings, penalty: float) -> Rows:
    """Keep the closest pairs of joints that are in contact within the contact distance."""
    n_a, n_b = scene.n_joints
    distances = joint_distances(scene.points)[:, :n_a, n_a:].reshape(len(scene.points), -1)
    n_pairs = min(settings.n_pairs, int((distances < settings.contact_distance).sum(axis=1).max()))
    order = np.argsort(distances, axis=1, kind="stable")[:, :n_pairs]
    distance = np.take_along_axis(distances, order, axis=1)
    ends = np.stack([order // n_b, n_a + order % n_b], axis=-1)
    limit = CONTACT_MARGIN * settings.contact_distance
    penalties = _pair_penalties(penalty, distance - settings.contact_distance)
    return Rows(
        points=np.concatenate([ends, ends], axis=-1),
        coefficients=np.broadcast_to([-1.0, 1.0, 0.0, 0.0], (*distance.shape, 4)),
        penalties=penalties,
        lower=np.zeros(distance.shape),
        upper=limit + RELEASE * (distance - settings.contact_distance).clip(min=0),
        elasticity=_elasticity(settings.contact_stiffness, penalties),
        n_body_rows=0,
    )


def _pair_penalties(penalty: float, gaps: Array) -> Array:
    """Return the penalties of pairs, which fall with what is between them in the source.

    A penalty on a pair that is far from its bound would only slow the convergence of both bodies.
    """
    penalties: Array = penalty * np.exp(-((gaps.clip(min=0) / PAIR_PENALTY_RANGE) ** 4))
    return penalties


def _elasticity(stiffness: float, penalties: Array) -> Array:
    """Return how far the proximal point of an elastic bound is on the way to its projection."""
    return stiffness / (stiffness + penalties)


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
