"""Measurements of the quality of a variation."""

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from pacmo_core.interaction_mesh.linear_algebra import batched_product
from pacmo_core.interaction_mesh.mesh import hinge_joints, support_steps
from pacmo_core.interaction_mesh.scene import Array, Scene, Single
from pacmo_core.interaction_mesh.settings import AttemptLimits, Settings

# Frames before and after a frame whose median its acceleration is compared with.
MEDIAN_RADIUS = 10
# Frames whose near pairs are measured together.
FRAMES_PER_BATCH = 64
# Minimal sine of the bend angle at which the bend direction of a limb is defined.
MIN_BEND_SINE = 0.25


@dataclass(frozen=True, kw_only=True)
class Report:
    """Measurements of one variation, before the scene is scaled as a whole.

    Parameters
    ----------
    near_distance_error, far_distance_error : metres, mean change of the distances between joints
        of the two bodies, of pairs near in the source and of all others
    near_distance_error_naive : the same of naive scaling
    contacts_preserved : fraction of the pairs and frames in contact in the source
    added_foot_skate : metres per second, mean horizontal speed of supporting joints in addition to
        the source's
    penetration : metres, largest decrease of a distance between joints of the two bodies, within
        the clearance
    acceleration_peak_ratio : the largest mean acceleration of a frame over the median of the frames
        around it, relative to the source's own ratio where that is above 1
    bend_flip_fraction : fraction of frames in which an elbow or knee bends to the other side
    attempt : number of the attempt, from 0
    primal_residual : largest relative error of a bone length before it is set to its target
    fixed_point_residual : step of the last ADMM iteration, root mean square, relative to the
        growth of the bones (``retargeting.step_scale``)
    iterations : of ADMM in the attempt
    energy : the terms by name
    """

    near_distance_error: float
    far_distance_error: float
    near_distance_error_naive: float
    contacts_preserved: float
    added_foot_skate: float
    penetration: float
    acceleration_peak_ratio: float
    bend_flip_fraction: float
    attempt: int
    primal_residual: float
    fixed_point_residual: float
    iterations: int
    energy: dict[str, float]

    def limit_ratio(self, limits: AttemptLimits) -> float:
        """Return the largest ratio of a measurement to its limit; at most 1 if accepted."""
        return max(
            self.primal_residual / limits.primal_residual,
            self.penetration / limits.penetration,
            self.acceleration_peak_ratio / limits.acceleration_peak_ratio,
        )

    def has_diverged(self, limits: AttemptLimits) -> bool:
        """Whether more iterations of the same attempt will not help."""
        return (
            self.primal_residual > limits.primal_residual
            or self.acceleration_peak_ratio > limits.acceleration_peak_ratio
        )


def measure_motions(
    scene: Scene, settings: Settings, is_support: NDArray[np.bool_], points: Array
) -> dict[str, Array]:
    """Measure motions (T, N, 3, V), metres: by the names of ``Report``, (V,) each."""
    distances = measure_distances(scene, settings, points)
    source_skate = _foot_skate(scene.points[..., None], is_support, scene.fps)
    return {
        "near_distance_error": distances.near,
        "far_distance_error": distances.far,
        "contacts_preserved": distances.contacts_preserved,
        "added_foot_skate": _foot_skate(points, is_support, scene.fps) - source_skate,
        "penetration": distances.penetration.clip(min=0),
        "acceleration_peak_ratio": _acceleration_peak_ratio(scene, points),
        "bend_flip_fraction": bend_flip_fraction(scene, points),
    }


@dataclass(frozen=True)
class DistanceErrors:
    """Errors of the distances between joints of the two bodies in V motions, (V,) each.

    Parameters
    ----------
    near : metres, mean change of the distance of pairs that are near in the source
    far : metres, of all others
    contacts_preserved : fraction of the pairs in contact in the source
    penetration : metres, largest decrease of a distance within the clearance
    """

    near: Array
    far: Array
    contacts_preserved: Array
    penetration: Array


def measure_distances(scene: Scene, settings: Settings, points: Array) -> DistanceErrors:
    """Compare motions (T, N, 3, V), metres, with the source.

    Without near pairs the error is 0; without contacts all are preserved.
    """
    n_bodies = points.shape[-1]
    sums, counts = np.zeros((3, n_bodies)), np.zeros(3)
    # The maximum over frames is taken pair by pair: reductions along few columns are slow.
    depths = np.zeros((*scene.n_joints, n_bodies), dtype=np.float32).reshape(-1, n_bodies)
    for pose, frame in zip(scene.points, points, strict=True):
        before = _inter_body_distances(scene, pose[..., None])
        near, contact = (
            before[:, 0] < limit for limit in (settings.near_distance, settings.contact_distance)
        )
        after = _inter_body_distances(scene, frame)
        preserved = after[contact] < settings.contact_distance + settings.contact_slack
        np.subtract(before, after, out=after)
        np.maximum(depths, after - (before - settings.clearance).clip(min=0), out=depths)
        weights: Single = np.stack([near, ~near]).astype(np.float32)
        np.abs(after, out=after)
        sums[:2] += batched_product(weights, after)
        sums[2] += preserved.sum(axis=0)
        counts += [near.sum(), (~near).sum(), contact.sum()]
    means = sums / counts.clip(min=1)[:, None]
    contacts_preserved = means[2] if counts[2] else np.ones(n_bodies)
    penetration = depths.max(axis=0).astype(np.float64)
    return DistanceErrors(means[0], means[1], contacts_preserved, penetration)


def near_distance_error(scene: Scene, settings: Settings, points: Array) -> Array:
    """Return ``measure_distances(...).near``, (V,), without measuring other pairs."""
    total, count = np.zeros(points.shape[-1]), 0
    for first in range(0, len(points), FRAMES_PER_BATCH):
        batch = slice(first, first + FRAMES_PER_BATCH)
        poses, varied = scene.points[batch], points[batch]
        a, b = np.split(poses, [scene.n_joints[0]], axis=1)
        before = np.linalg.norm(a[:, :, None] - b[:, None], axis=-1)
        frames, joints_a, joints_b = np.nonzero(before < settings.near_distance)
        vectors = varied[frames, joints_a] - varied[frames, scene.n_joints[0] + joints_b]
        after = np.sqrt(np.einsum("pcv,pcv->pv", vectors, vectors))
        total += np.abs(after - before[frames, joints_a, joints_b, None]).sum(axis=0)
        count += len(frames)
    return total / max(1, count)


def _inter_body_distances(scene: Scene, pose: Array) -> Single:
    """``(J_a J_b, V)`` float32 metres."""
    # Relative to the centre of the frame: a common offset would cost float32 its digits.
    centred = (pose - pose.mean(axis=0)).astype(np.float32).transpose(1, 0, 2)
    a, b = centred[:, : scene.n_joints[0], None], centred[:, None, scene.n_joints[0] :]
    squared = part = np.zeros((a.shape[1], b.shape[2], pose.shape[-1]), dtype=np.float32)
    for axis_a, axis_b in zip(a, b, strict=True):
        part = np.subtract(axis_a, axis_b, out=None if part is squared else part)
        squared += np.multiply(part, part, out=part)
    distances: Single = np.sqrt(squared, out=squared).reshape(-1, pose.shape[-1])
    return distances


def acceleration_ratios(points: Array) -> Array:
    """Return the mean acceleration of the joints over the median of the frames around it.

    Parameters
    ----------
    points : (T, N, 3, V), T >= 3

    Returns
    -------
    (T - 2, V)
    """
    differences = points[2:] - points[1:-1]
    differences -= points[1:-1]
    differences += points[:-2]
    accelerations = np.sqrt(np.einsum("tncv,tncv->tnv", differences, differences)).mean(axis=1)
    padded = np.pad(accelerations, ((MEDIAN_RADIUS, MEDIAN_RADIUS), (0, 0)), mode="reflect")
    medians = np.median(sliding_window_view(padded, 2 * MEDIAN_RADIUS + 1, axis=0), axis=-1)
    ratios: Array = accelerations / np.maximum(medians, np.finfo(np.float32).tiny)
    return ratios


def _acceleration_peak_ratio(scene: Scene, points: Array) -> Array:
    if len(scene.points) < MEDIAN_RADIUS + 3:
        return np.ones(points.shape[-1])
    source_ratios = np.maximum(1, acceleration_ratios(scene.points[..., None]))
    ratio: Array = (acceleration_ratios(points) / source_ratios).max(axis=0)
    return ratio


def _foot_skate(points: Array, is_support: NDArray[np.bool_], fps: float) -> Array:
    """``(V,)`` metres per second: mean horizontal speed of supporting joints."""
    steps = support_steps(is_support)
    if not steps.any():
        return np.zeros(points.shape[-1])
    frame, joint = np.nonzero(steps)
    moves = points[frame + 1, joint, ::2] - points[frame, joint, ::2]
    speeds: Array = np.linalg.norm(moves, axis=1).mean(axis=0) * fps
    return speeds


def bend_flip_fraction(scene: Scene, points: Array) -> Array:
    """``(V,)``: fraction of frames in which an elbow or knee bends opposite to the source.

    Joints that are straight in either motion do not count.

    Parameters
    ----------
    points : (T, N, 3, V) metres
    """
    hinges = hinge_joints(scene)
    if not len(hinges):
        return np.zeros(points.shape[-1])
    source_normals, was_bent = _bend_normals(scene.points[..., None], hinges)
    normals, is_bent = _bend_normals(points, hinges)
    is_flipped = was_bent & is_bent & ((source_normals * normals).sum(axis=2) < 0)
    fraction: Array = is_flipped.any(axis=1).mean(axis=0)
    return fraction


def _bend_normals(points: Array, hinges: NDArray[np.intp]) -> tuple[Array, NDArray[np.bool_]]:
    """Return the normal of each hinge's bend plane, (T, H, 3, V), and whether the hinge is bent."""
    first, middle, last = (points[:, hinges[:, end]] for end in range(3))
    upper, lower = middle - first, last - middle
    normals = np.cross(upper, lower, axis=2)
    upper_length, lower_length, normal_length = (
        np.linalg.norm(vectors, axis=2) for vectors in (upper, lower, normals)
    )
    return normals, normal_length > MIN_BEND_SINE * upper_length * lower_length
