"""Measurements of a variation: what changed that the other body does not explain.

Each is of the person for whom it is worse. Angles, heights and speeds are compared with the source,
contacts and penetration with the source at the same frame, all without the scale that both bodies
have in common: a scene that is scaled as a whole has no fault.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise
from math import inf

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from pacmo_core.interaction_mesh.body_parts import (
    RIGID,
    bone_to_joint,
    hinges,
    scene_bone_kinds,
    trunk_bends,
    trunk_joints,
)
from pacmo_core.interaction_mesh.mesh import support_steps
from pacmo_core.interaction_mesh.proximity import (
    capsule_penetration,
    contacts_kept,
    near_distance_error,
)
from pacmo_core.interaction_mesh.scene import (
    Array,
    Scene,
    common_scale,
    naive_scaling,
    scale_scene,
)
from pacmo_core.interaction_mesh.settings import Settings

# Seconds before and after a frame with the median of which its acceleration is compared, and the
# fraction of the mean acceleration that it is compared with at least.
MEDIAN_SECONDS = 1 / 3
REST_FRACTION = 0.5
# Minimal sine of the bend angle at which the bend direction of a limb is defined.
MIN_BEND_SINE = 0.25
# Metres between the nearest joints of the two people, from which on they are apart.
APART_DISTANCE = 0.5
PERCENTILE = 95
ANGLES = ("knee", "elbow", "hip", "shoulder", "spine")


@dataclass(frozen=True, kw_only=True)
class Report:
    """Measurements of one variation, of the person for whom each is worse.

    Parameters
    ----------
    knee_change, elbow_change, hip_change, shoulder_change, spine_change : degrees, mean over frames
        and joints of the absolute change of a joint's angle
    knee_change_p95, ... : degrees, 95th percentile of the same
    knee_change_apart : degrees, mean over the frames in which nobody is within 0.5 m of the other
    pelvis_height_error : metres, mean over frames: height of the root above the ground, against the
        source's times the scale of the leg
    support_height_error : metres, mean over frames: height of the lowest supporting joint, against
        the source's
    below_floor : metres, depth of the lowest joint below the person's lowest in the source
    trunk_change : largest relative error of a distance between two joints of the trunk, against
        bones that are scaled along their own directions; 95th percentile over frames, as hips may
        close for a while
    spine_bend : degrees, largest over frames: by which a joint of the spine bends more than in the
        source
    added_foot_skate : metres per second, mean horizontal speed of supporting joints in addition to
        the source's
    peak_acceleration_ratio : the largest mean acceleration of a frame over that of the source
    seam_ratio : the largest mean acceleration of a frame over the median of the frames around it,
        relative to the source's own ratio where that is above 1
    knee_flips, elbow_flips : fraction of frames in which a knee or elbow bends to the other side of
        its upper bone
    capsule_penetration : metres by which the bodies are deeper in each other than in the source
    contacts_kept : fraction of the pairs and frames in contact in the source that are in contact by
        the same distance
    contacts_kept_with_slack : the same, with a slack on the distance afterwards
    near_distance_error : metres, mean change of the distances between joints of the two bodies, of
        pairs near in the source, before the scene is scaled as a whole
    near_distance_error_naive : the same of naive scaling (``scene.naive_scaling``)
    attempt : number of the attempt, from 0
    primal_residual : largest relative error of a bone length before it is set to its target
    fixed_point_residual : step of the last ADMM iteration, root mean square, relative to the
        growth of the bones (``attempt.step_scale``)
    iterations : of ADMM in the attempt
    """

    knee_change: float
    knee_change_p95: float
    knee_change_apart: float
    elbow_change: float
    elbow_change_p95: float
    hip_change: float
    hip_change_p95: float
    shoulder_change: float
    shoulder_change_p95: float
    spine_change: float
    spine_change_p95: float
    pelvis_height_error: float
    support_height_error: float
    below_floor: float
    trunk_change: float
    spine_bend: float
    added_foot_skate: float
    peak_acceleration_ratio: float
    seam_ratio: float
    knee_flips: float
    elbow_flips: float
    capsule_penetration: float
    contacts_kept: float
    contacts_kept_with_slack: float
    near_distance_error: float
    near_distance_error_naive: float
    attempt: int
    primal_residual: float
    fixed_point_residual: float
    iterations: int


LOWER_LIMITS = ("contacts_kept",)  # measurements with a lower limit; all others have an upper one


def limit_ratio(name: str, value: float, limit: float) -> float:
    """Divide a measurement by its limit; at most 1 within the limit."""
    excess, allowed = (1 - value, 1 - limit) if name in LOWER_LIMITS else (value, limit)
    if allowed:
        return excess / allowed
    return inf if excess > 0 else 0.0


def measure_motions(
    scene: Scene, settings: Settings, is_support: NDArray[np.bool_], scales: Array, points: Array
) -> dict[str, Array]:
    """Measure motions (T, N, 3, V), metres, of bodies (V, E).

    All is relative to the scale that both bodies have in common.

    Returns
    -------
    (V,) each, by the names of ``Report``
    """
    scales, motions = without_common_scale(scene, scales, points)
    return {
        **measure_limited(scene, settings, scales, motions),
        **measure_unlimited(scene, settings, is_support, scales, motions),
    }


def without_common_scale(scene: Scene, scales: Array, points: Array) -> tuple[Array, Array]:
    """Divide bodies (V, E) and motions (T, N, 3, V) by the scale that both have in common."""
    common = common_scale(scene, scales)
    return scales / common[:, None], scale_scene(scene, points, 1 / common)


def measure_limited(
    scene: Scene, settings: Settings, scales: Array, motions: Array
) -> dict[str, Array]:
    """Measure what decides whether an attempt is accepted.

    Parameters
    ----------
    scales, motions : without the common scale
    """
    return {
        "contacts_kept": contacts_kept(scene, motions, settings.contact_distance, 0.0),
        "capsule_penetration": capsule_penetration(scene, motions),
        "trunk_change": trunk_change(scene, scales, motions),
        "spine_bend": spine_bend(scene, motions),
        "seam_ratio": seam_ratio(scene, motions),
    }


def measure_unlimited(
    scene: Scene, settings: Settings, is_support: NDArray[np.bool_], scales: Array, motions: Array
) -> dict[str, Array]:
    """Measure everything else; parameters as of ``measure_limited``."""
    people = measure_people(scene, is_support, scales, motions)
    naive = naive_scaling(scene, scales)
    return {
        **{name: np.maximum(people[0][name], people[1][name]) for name in people[0]},
        "contacts_kept_with_slack": contacts_kept(
            scene, motions, settings.contact_distance, settings.contact_slack
        ),
        "near_distance_error": near_distance_error(scene, motions, settings.near_distance),
        "near_distance_error_naive": near_distance_error(scene, naive, settings.near_distance),
    }


def measure_people(
    scene: Scene, is_support: NDArray[np.bool_], scales: Array, motions: Array
) -> list[dict[str, Array]]:
    """Measure each person alone: of ``measure_unlimited``, what is that of one person."""
    return [_measure_person(scene, is_support, scales, motions, person) for person in (0, 1)]


def _measure_person(
    scene: Scene, is_support: NDArray[np.bool_], scales: Array, points: Array, person: int
) -> dict[str, Array]:
    """Measure one person."""
    n_a = scene.n_joints[0]
    joints = slice(None, n_a) if person == 0 else slice(n_a, None)
    source, body = scene.points[:, joints, :, None], points[:, joints]
    lowest = scene.levels.lowest[joints][0]
    skate = [_foot_skate(p, is_support[:, joints], scene.fps) for p in (body, source)]
    flips = bend_flips(scene, points, person)
    measures = {
        "pelvis_height_error": _mean(np.abs(pelvis_rises(scene, scales, points, person))),
        "support_height_error": _support_height_error(source, body, is_support[:, joints]),
        "below_floor": (lowest - body[:, :, 1].min(axis=(0, 1))).clip(min=0),
        "added_foot_skate": skate[0] - skate[1],
        "peak_acceleration_ratio": peak_acceleration_ratio(source, body),
        "knee_flips": flips["knee"],
        "elbow_flips": flips["elbow"],
    }
    is_apart = ~_is_within_reach(scene)
    for name in ANGLES:
        changes = angle_changes(scene, points, person, name)
        flat = changes.reshape(-1, points.shape[-1])
        measures[f"{name}_change"] = _mean(flat)
        measures[f"{name}_change_p95"] = (
            np.percentile(flat, PERCENTILE, axis=0) if len(flat) else np.zeros(flat.shape[-1])
        )
        if name == "knee":
            measures["knee_change_apart"] = _mean(changes[is_apart].reshape(-1, points.shape[-1]))
    return measures


def angle_changes(scene: Scene, points: Array, person: int, name: str) -> Array:
    """Return the absolute changes of a person's angles of one name, ``(T, K, V)`` degrees.

    Knees and elbows: between the two bones. Hips and shoulders: between the limb's first bone and
    the trunk, from the middle of the hips to the middle of the shoulders. Spine: between
    consecutive bones from the root to where the arms begin.
    """
    pairs = [vectors for _, *vectors in _angle_vectors(scene, person, name)]
    return np.abs(_bends(scene, points, pairs))


def angle_joints(scene: Scene, person: int, name: str) -> list[int]:
    """List the joints, of both people together, at which ``angle_changes`` are."""
    return [joint for joint, *_ in _angle_vectors(scene, person, name)]


def _bends(scene: Scene, points: Array, pairs: Iterable[Sequence["_Vector"]]) -> Array:
    """``(T, K, V)`` degrees by which angles between two vectors are larger than in the source."""
    empty = np.zeros((len(points), 0, points.shape[-1]))
    bends = [
        _angle(*(_vectors(points, vector) for vector in pair))
        - _angle(*(_vectors(scene.points[..., None], vector) for vector in pair))
        for pair in pairs
    ]
    return np.stack(bends, axis=1) if bends else empty


_Vector = tuple[list[int], list[int]]  # from the middle of some points to that of others


def _angle_vectors(scene: Scene, person: int, name: str) -> list[tuple[int, _Vector, _Vector]]:
    """List the joint of each angle of one name, and the two vectors between which it is."""
    bones = [_bone_vector(scene, row) for row in range(len(scene.bones))]
    kinds = scene_bone_kinds(scene)
    first = scene.n_bones[0] if person else 0
    own = range(first, first + scene.n_bones[person])
    if name in ("knee", "elbow"):
        pairs, names = hinges(scene)
        rows = [pair for pair, n in zip(pairs.tolist(), names, strict=True) if n == name]
        return [
            (int(scene.bones[lower, 0]), bones[upper], bones[lower])
            for upper, lower in rows
            if lower in own
        ]
    upper = {"hip": "thigh", "shoulder": "upper_arm"}
    roots = {k: [row for row in own if kinds[row] == k] for k in upper.values()}
    if not all(roots.values()):
        return []
    hips, shoulders = ([int(scene.bones[row, 0]) for row in rows] for rows in roots.values())
    if name in upper:
        trunk = (hips, shoulders)
        return [(int(scene.bones[row, 0]), trunk, bones[row]) for row in roots[upper[name]]]
    chains = [_chain_to_root(scene, joint) for joint in shoulders]
    shared = [row for row in chains[0] if all(row in chain for chain in chains)]
    return [
        (int(scene.bones[upper, 0]), bones[lower], bones[upper])
        for upper, lower in pairwise(shared)
    ]


def _bone_vector(scene: Scene, row: int) -> _Vector:
    parent, child = scene.bones[row].tolist()
    return [parent], [child]


def _chain_to_root(scene: Scene, joint: int) -> list[int]:
    """List the bones from a joint to the root of its body."""
    bone_of, chain = bone_to_joint(scene), []
    while joint in bone_of:
        chain.append(bone_of[joint])
        joint = int(scene.bones[chain[-1], 0])
    return chain


def _vectors(points: Array, vector: _Vector) -> Array:
    begin, end = (points[:, joints].mean(axis=1) for joints in vector)
    difference: Array = end - begin
    return difference


def _angle(first: Array, second: Array) -> Array:
    """``(T, V)`` degrees between vectors (T, 3, V)."""
    cross = np.cross(first, second, axis=1)
    angle: Array = np.degrees(np.arctan2(_lengths(cross), np.einsum("tcv,tcv->tv", first, second)))
    return angle


def _is_within_reach(scene: Scene) -> NDArray[np.bool_]:
    """``(T,)``: whether any two joints of the two people are within ``APART_DISTANCE``."""
    nearest = np.full(len(scene.points), np.inf)
    a, b = np.split(scene.points, [scene.n_joints[0]], axis=1)
    for joint in range(a.shape[1]):
        distances = np.linalg.norm(b - a[:, joint, None], axis=-1)
        nearest = np.minimum(nearest, distances.min(axis=1))
    return nearest < APART_DISTANCE


def pelvis_rises(scene: Scene, scales: Array, points: Array, person: int) -> Array:
    """``(T, V)`` metres of a person's root above where legs of their scales carried it."""
    root = scene.n_joints[0] * person + scene.skeletons[person].root
    first = scene.n_bones[0] * person
    kinds = scene_bone_kinds(scene)
    own = range(first, first + scene.n_bones[person])
    legs = [row for row in own if kinds[row] in ("thigh", "shin")] or list(own)
    lengths = np.linalg.norm(scene.bone_vectors[:, legs], axis=-1).mean(axis=0)
    leg_scale = np.average(scales[:, legs], axis=1, weights=lengths)
    before = scene.points[:, root, 1, None] - scene.ground_height
    rises: Array = points[:, root, 1] - scene.ground_height - leg_scale * before
    return rises


def _support_height_error(source: Array, body: Array, is_support: NDArray[np.bool_]) -> Array:
    """``(V,)`` metres."""
    stands = is_support.any(axis=1)
    supports = is_support[stands][:, :, None]
    before, after = (
        np.where(supports, motion[stands, :, 1], np.inf).min(axis=1, initial=np.inf)
        for motion in (source, body)
    )
    return _mean(np.abs(after - before))


def trunk_change(scene: Scene, scales: Array, points: Array) -> Array:
    """Return ``Report.trunk_change``, (V,); zero without a trunk."""
    largest: Array = trunk_errors(scene, scales, points)[1].max(axis=0, initial=0.0)
    return largest


def trunk_errors(scene: Scene, scales: Array, points: Array) -> tuple[list[tuple[int, int]], Array]:
    """List the pairs of joints of a trunk, and their errors that ``trunk_change`` compares.

    Returns
    -------
    (K,) pairs, and (K, V): of each the 95th percentile over frames of its relative error
    """
    expected, shortest = naive_scaling(scene, scales), np.finfo(np.float32).tiny
    pairs = [pair for joints in trunk_joints(scene) for pair in combinations(joints.tolist(), 2)]
    errors = np.zeros((len(pairs), len(scales)))
    for row, (i, j) in enumerate(pairs):
        wanted = np.maximum(_lengths(expected[:, i] - expected[:, j]), shortest)
        ratios = _lengths(points[:, i] - points[:, j]) / wanted
        errors[row] = np.percentile(np.abs(ratios - 1), PERCENTILE, axis=0)
    return pairs, errors


def spine_bend(scene: Scene, points: Array) -> Array:
    """Return ``Report.spine_bend``, (V,); zero without a spine."""
    largest: Array = spine_bends(scene, points)[1].max(axis=(0, 1), initial=0.0)
    return largest


def spine_bends(scene: Scene, points: Array) -> tuple[list[int], Array]:
    """List the joints between the bones of spine and neck, and their bends.

    Returns
    -------
    (K,) joints, and (T, K, V) degrees by which the two bones of each bend more than in the source
    """
    pairs, kinds = trunk_bends(scene)
    rows = pairs[kinds != RIGID].tolist()
    bends = _bends(scene, points, [[_bone_vector(scene, row) for row in pair] for pair in rows])
    return [int(scene.bones[second, 0]) for _, second in rows], bends


def _lengths(vectors: Array) -> Array:
    """``(T, V)``, of vectors (T, 3, V)."""
    lengths: Array = np.sqrt(np.einsum("tcv,tcv->tv", vectors, vectors))
    return lengths


def peak_acceleration_ratio(source: Array, body: Array) -> Array:
    """Return the largest mean acceleration of a frame over the source's, (V,), of one person.

    Parameters
    ----------
    source, body : (T, J, 3, 1) and (T, J, 3, V) metres
    """
    if len(source) < 3:
        return np.ones(body.shape[-1])
    before, after = mean_accelerations(source), mean_accelerations(body)
    ratio: Array = after.max(axis=0) / np.maximum(before.max(axis=0), np.finfo(np.float32).tiny)
    return ratio


def seam_ratio(scene: Scene, points: Array) -> Array:
    """Return ``Report.seam_ratio`` of motions (T, N, 3, V), (V,)."""
    n_a = scene.n_joints[0]
    if len(points) < 3:
        return np.ones(points.shape[-1])
    largest: Array = np.concatenate(
        [
            seams(scene.points[:, joints, :, None], points[:, joints], scene.fps)
            for joints in (slice(None, n_a), slice(n_a, None))
        ]
    ).max(axis=0)
    return largest


def seams(source: Array, body: Array, fps: float) -> Array:
    """``(F, V)``: accelerations of one person over those of the frames around.

    Relative to the source's own ratios, where those are above 1.
    """
    radius = max(1, round(MEDIAN_SECONDS * fps))
    before = seam_ratios(mean_accelerations(source), radius)
    ratios: Array = seam_ratios(mean_accelerations(body), radius) / np.maximum(1, before)
    return ratios


def mean_accelerations(points: Array) -> Array:
    """Return the mean over joints of the second difference, ``(T - 2, V)``, of (T, N, 3, V)."""
    differences = points[2:] - points[1:-1]
    differences -= points[1:-1]
    differences += points[:-2]
    norms: Array = np.sqrt(np.einsum("tncv,tncv->tnv", differences, differences)).mean(axis=1)
    return norms


def seam_ratios(accelerations: Array, radius: int) -> Array:
    """Return accelerations (F, V) over the median of the frames around each.

    Where these are at rest, over a fraction of the motion's mean.
    """
    radius = min(radius, len(accelerations) - 1)
    padded = np.pad(accelerations, ((radius, radius), (0, 0)), mode="reflect")
    medians = np.median(sliding_window_view(padded, 2 * radius + 1, axis=0), axis=-1)
    least = REST_FRACTION * accelerations.mean(axis=0) + np.finfo(np.float32).tiny
    ratios: Array = accelerations / np.maximum(medians, least)
    return ratios


def _foot_skate(points: Array, is_support: NDArray[np.bool_], fps: float) -> Array:
    """``(V,)`` metres per second: mean horizontal speed of supporting joints."""
    steps = support_steps(is_support)
    if not steps.any():
        return np.zeros(points.shape[-1])
    frame, joint = np.nonzero(steps)
    moves = points[frame + 1, joint, ::2] - points[frame, joint, ::2]
    speeds: Array = np.linalg.norm(moves, axis=1).mean(axis=0) * fps
    return speeds


def bend_flips(scene: Scene, points: Array, person: int) -> dict[str, Array]:
    """Return the fraction of frames in which a knee, or elbow, bends to the other side.

    That is, in which the limb's bend plane has turned about the upper bone by more than 90 degrees.
    The upper bone carries the plane of the source along by the smallest rotation: a limb that is
    raised as a whole, because the other's hand is higher, bends as before. Joints that are straight
    in either motion do not count.

    Parameters
    ----------
    points : (T, N, 3, V) metres

    Returns
    -------
    (V,) each, by ``knee`` and ``elbow``
    """
    fractions = {}
    for name in ("knee", "elbow"):
        flipped = np.zeros((len(points), points.shape[-1]), dtype=np.bool_)
        for _, upper, lower in _angle_vectors(scene, person, name):
            source = scene.points[..., None]
            before, was_bent = _bend_normal(source, upper, lower)
            after, is_bent = _bend_normal(points, upper, lower)
            cosine = _carried_product(_unit(source, upper), _unit(points, upper), before, after)
            flipped |= was_bent & is_bent & (cosine < 0)
        fractions[name] = flipped.mean(axis=0)
    return fractions


def _bend_normal(points: Array, upper: _Vector, lower: _Vector) -> tuple[Array, NDArray[np.bool_]]:
    """Return the normal of a hinge's bend plane, (T, 3, V), and whether the hinge is bent."""
    first, second = _vectors(points, upper), _vectors(points, lower)
    normal = np.cross(first, second, axis=1)
    sine = np.linalg.norm(normal, axis=1)
    scale = np.linalg.norm(first, axis=1) * np.linalg.norm(second, axis=1)
    return normal, sine > MIN_BEND_SINE * scale


def _unit(points: Array, vector: _Vector) -> Array:
    """Return the direction of a vector, (T, 3, V)."""
    difference = _vectors(points, vector)
    direction: Array = difference / np.linalg.norm(difference, axis=1, keepdims=True)
    return direction


def _carried_product(first: Array, second: Array, before: Array, after: Array) -> Array:
    """Return ``(1 + first . second) (R before) . after``, (T, V), of vectors (T, 3, V).

    R is the smallest rotation from ``first`` to ``second``, to which ``before`` and ``after`` are
    normal: ``R b = b - (b . second) (first + second) / (1 + first . second)``.
    """

    def dot(a: Array, b: Array) -> Array:
        product: Array = (a * b).sum(axis=1)
        return product

    return (1 + dot(first, second)) * dot(before, after) - dot(before, second) * dot(first, after)


def _mean(values: Array) -> Array:
    """Mean over the first axis; zeros if it is empty."""
    mean: Array = values.mean(axis=0) if len(values) else np.zeros(values.shape[1:])
    return mean
