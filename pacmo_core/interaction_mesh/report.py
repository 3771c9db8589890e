"""How good a variation is."""

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from pacmo_core.interaction_mesh.energy import bend_flip_fraction, support_steps
from pacmo_core.interaction_mesh.linear_algebra import batched_product
from pacmo_core.interaction_mesh.scene import Array, Scene, Single
from pacmo_core.interaction_mesh.settings import AttemptLimits, Settings

# Frames to either side among which a frame's acceleration is judged.
MEDIAN_RADIUS = 10


@dataclass(frozen=True, kw_only=True)
class Report:
    """Figures of one variation, before the scene is scaled as a whole.

    Parameters
    ----------
    near_distance_error, far_distance_error : metres, by how much distances between the bodies differ from the
        source's, in pairs of joints near in it and in all others
    near_distance_error_naive : the same of naive scaling
    contacts_preserved : share of touching pairs and frames
    added_foot_skate : metres a second that standing joints move more than in the source
    penetration : metres that joints come closer than in the source, within the clearance, at worst
    acceleration_peak_ratio : the largest mean acceleration of a frame over the median of those around it, or
        over the source's own such ratio where that is above 1
    bend_flip_fraction : of frames, those where an elbow or knee bends to the other side
    attempt : which try it is, from 0
    primal_residual : share of its length by which a bone missed it before it was set, at worst
    fixed_point_residual : by how much the solver's last iteration still moved bones, root mean square, as a
        share of what the body is asked to change (``ladder.asked_of``)
    iterations : of the try
    energy : the terms
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

    def badness(self, limits: AttemptLimits) -> float:
        """Give the worst of its figures as a share of their limits: good up to 1."""
        return max(
            self.primal_residual / limits.primal_residual,
            self.penetration / limits.penetration,
            self.acceleration_peak_ratio / limits.acceleration_peak_ratio,
        )

    def astray(self, limits: AttemptLimits) -> bool:
        """Say whether the solver went where more iterations will not help."""
        return (
            self.primal_residual > limits.primal_residual
            or self.acceleration_peak_ratio > limits.acceleration_peak_ratio
        )


def measure_motions(
    scene: Scene, settings: Settings, standing: NDArray[np.bool_], points: Array
) -> dict[str, Array]:
    """Measure motions (T, N, 3, V), metres, by ``Report``'s names, (V,) each."""
    ours = measure_distances(scene, settings, points)
    own_slide = _foot_skate(scene.points[..., None], standing, scene.fps)
    return {
        "near_distance_error": ours.near,
        "far_distance_error": ours.far,
        "contacts_preserved": ours.kept,
        "added_foot_skate": _foot_skate(points, standing, scene.fps) - own_slide,
        "penetration": ours.penetration.clip(min=0),
        "acceleration_peak_ratio": _acceleration_peak_ratio(scene, points),
        "bend_flip_fraction": bend_flip_fraction(scene, points),
    }


def acceleration_ratios(points: Array) -> Array:
    """``(T - 2, V)``: mean acceleration of the joints over the median of the frames around.

    Parameters
    ----------
    points : (T, N, 3, V), T >= 3
    """
    bends = points[2:] - points[1:-1]
    bends -= points[1:-1]
    bends += points[:-2]
    accelerations = np.sqrt(np.einsum("tncv,tncv->tnv", bends, bends)).mean(axis=1)
    padded = np.pad(accelerations, ((MEDIAN_RADIUS, MEDIAN_RADIUS), (0, 0)), mode="reflect")
    medians = np.median(sliding_window_view(padded, 2 * MEDIAN_RADIUS + 1, axis=0), axis=-1)
    ratios: Array = accelerations / np.maximum(medians, np.finfo(np.float32).tiny)
    return ratios


def _acceleration_peak_ratio(scene: Scene, points: Array) -> Array:
    if len(scene.points) < MEDIAN_RADIUS + 3:
        return np.ones(points.shape[-1])
    own = np.maximum(1, acceleration_ratios(scene.points[..., None]))
    ratio: Array = (acceleration_ratios(points) / own).max(axis=0)
    return ratio


def _foot_skate(points: Array, standing: NDArray[np.bool_], fps: float) -> Array:
    """``(V,)`` metres a second: mean horizontal speed of what stands."""
    stands = support_steps(standing)
    if not stands.any():
        return np.zeros(points.shape[-1])
    frame, joint = np.nonzero(stands)
    steps = points[frame + 1, joint, ::2] - points[frame, joint, ::2]
    speeds: Array = np.linalg.norm(steps, axis=1).mean(axis=0) * fps
    return speeds


# FROM """What became of the distances between the two bodies."""
FRAMES_PER_BATCH = 64  # whose near pairs are looked at together


@dataclass(frozen=True)
class DistanceErrors:
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


def measure_distances(scene: Scene, settings: Settings, points: Array) -> DistanceErrors:
    """Compare the motions (T, N, 3, V), metres, with the source.

    Where no pair is near, or none touches, nothing is lost: 0 and 1.
    """
    n_bodies = points.shape[-1]
    sums, counts = np.zeros((3, n_bodies)), np.zeros(3)
    # Over frames pair by pair: rows of few columns are slow to reduce.
    deeper = np.zeros((*scene.n_joints, n_bodies), dtype=np.float32).reshape(-1, n_bodies)
    for pose, frame in zip(scene.points, points, strict=True):
        before = _inter_body_distances(scene, pose[..., None])
        near, touching = (
            before[:, 0] < limit for limit in (settings.near_distance, settings.contact_distance)
        )
        after = _inter_body_distances(scene, frame)
        kept = after[touching] < settings.contact_distance + settings.contact_slack
        np.subtract(before, after, out=after)
        np.maximum(deeper, after - (before - settings.clearance).clip(min=0), out=deeper)
        weights: Single = np.stack([near, ~near]).astype(np.float32)
        np.abs(after, out=after)
        sums[:2] += batched_product(weights, after)
        sums[2] += kept.sum(axis=0)
        counts += [near.sum(), (~near).sum(), touching.sum()]
    means = sums / counts.clip(min=1)[:, None]
    kept_share = means[2] if counts[2] else np.ones(n_bodies)
    return DistanceErrors(means[0], means[1], kept_share, deeper.max(axis=0).astype(np.float64))


def near_distance_error(scene: Scene, settings: Settings, points: Array) -> Array:
    """``(V,)``: what ``distances_of`` finds of near pairs, without looking at others."""
    total, count = np.zeros(points.shape[-1]), 0
    for first in range(0, len(points), FRAMES_PER_BATCH):
        block = slice(first, first + FRAMES_PER_BATCH)
        poses, varied = scene.points[block], points[block]
        a, b = np.split(poses, [scene.n_joints[0]], axis=1)
        before = np.linalg.norm(a[:, :, None] - b[:, None], axis=-1)
        frames, own, other = np.nonzero(before < settings.near_distance)
        vectors = varied[frames, own] - varied[frames, scene.n_joints[0] + other]
        after = np.sqrt(np.einsum("pcv,pcv->pv", vectors, vectors))
        total += np.abs(after - before[frames, own, other, None]).sum(axis=0)
        count += len(frames)
    return total / max(1, count)


def _inter_body_distances(scene: Scene, pose: Array) -> Single:
    """``(J_a J_b, V)`` float32 metres."""
    # About the middle of the frame, lest a common offset swallow the digits.
    centred = (pose - pose.mean(axis=0)).astype(np.float32).transpose(1, 0, 2)
    a, b = centred[:, : scene.n_joints[0], None], centred[:, None, scene.n_joints[0] :]
    squared = part = np.zeros((a.shape[1], b.shape[2], pose.shape[-1]), dtype=np.float32)
    for own, other in zip(a, b, strict=True):
        part = np.subtract(own, other, out=None if part is squared else part)
        squared += np.multiply(part, part, out=part)
    distances: Single = np.sqrt(squared, out=squared).reshape(-1, pose.shape[-1])
    return distances
