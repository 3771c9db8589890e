"""What became of the distances between the two bodies."""

from dataclasses import dataclass

import numpy as np

from pacmo_core.interaction_mesh.products import product
from pacmo_core.interaction_mesh.scene import Array, Scene, Single
from pacmo_core.interaction_mesh.settings import Settings

FRAMES = 64  # whose near pairs are looked at together


@dataclass(frozen=True)
class Distances:
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


def distances_of(scene: Scene, settings: Settings, points: Array) -> Distances:
    """Compare the motions (T, N, 3, V), metres, with the source.

    Where no pair is near, or none touches, nothing is lost: 0 and 1.
    """
    n_bodies = points.shape[-1]
    sums, counts = np.zeros((3, n_bodies)), np.zeros(3)
    # Over frames pair by pair: rows of few columns are slow to reduce.
    deeper = np.zeros((*scene.n_joints, n_bodies), dtype=np.float32).reshape(-1, n_bodies)
    for pose, frame in zip(scene.points, points, strict=True):
        before = _between(scene, pose[..., None])
        near, touching = (before[:, 0] < limit for limit in (settings.near, settings.touching))
        after = _between(scene, frame)
        kept = after[touching] < settings.touching + settings.slack
        np.subtract(before, after, out=after)
        np.maximum(deeper, after - (before - settings.clearance).clip(min=0), out=deeper)
        weights: Single = np.stack([near, ~near]).astype(np.float32)
        np.abs(after, out=after)
        sums[:2] += product(weights, after)
        sums[2] += kept.sum(axis=0)
        counts += [near.sum(), (~near).sum(), touching.sum()]
    means = sums / counts.clip(min=1)[:, None]
    kept_share = means[2] if counts[2] else np.ones(n_bodies)
    return Distances(means[0], means[1], kept_share, deeper.max(axis=0).astype(np.float64))


def near_error(scene: Scene, settings: Settings, points: Array) -> Array:
    """``(V,)``: what ``distances_of`` finds of near pairs, without looking at others."""
    total, count = np.zeros(points.shape[-1]), 0
    for first in range(0, len(points), FRAMES):
        block = slice(first, first + FRAMES)
        poses, varied = scene.points[block], points[block]
        a, b = np.split(poses, [scene.n_joints[0]], axis=1)
        before = np.linalg.norm(a[:, :, None] - b[:, None], axis=-1)
        frames, own, other = np.nonzero(before < settings.near)
        vectors = varied[frames, own] - varied[frames, scene.n_joints[0] + other]
        after = np.sqrt(np.einsum("pcv,pcv->pv", vectors, vectors))
        total += np.abs(after - before[frames, own, other, None]).sum(axis=0)
        count += len(frames)
    return total / max(1, count)


def _between(scene: Scene, pose: Array) -> Single:
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
