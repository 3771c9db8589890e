"""Errors of retargeted pairs, for each character: E_r, E_b, JPD, contacts, foot skate, FID.

Pairs are ``(T, 2, J, 3)`` float32, metres: both characters at the same times. Names and symbols are
those of the supplement of the two-person augmentation paper, which does not define them; the
definitions here are the simplest ones.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.interaction import Motion, min_point_distance
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.metrics.f2id import f2id
from pacmo_core.metrics.plausibility import BodyJoints

Pair = NDArray[np.float32]
Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class RetargetingLimits:
    """Thresholds of contact, stance and penetration.

    Parameters
    ----------
    contact_distance : metres between joints in contact
    contact_slack : metres by which a preserved contact may exceed the contact distance
    foot_height : metres above the lowest position of a foot below which it is in stance
    body_radius : metres between points of two bodies below which they penetrate
    """

    contact_distance: float
    contact_slack: float
    foot_height: float
    body_radius: float


def joint_error(pair: Pair, truth: Pair) -> Array:
    """Return E_r, ``(2,)`` metres: mean distance of joints from their true positions."""
    _check_shapes(pair, truth)
    return np.asarray(np.linalg.norm(pair - truth, axis=-1).mean(axis=(0, 2), dtype=np.float64))


def bone_error(pair: Pair, template: Pair, scales: Array, skeleton: Skeleton) -> Array:
    """Return E_b, ``(2,)`` metres: mean error of bone lengths of each character.

    The true length is the scale times the length of the template in the same frame.

    Parameters
    ----------
    scales : (2, E), in the order of ``skeleton.bones``
    """
    _check_shapes(pair, template)
    error = np.abs(_lengths(pair, skeleton) - scales * _lengths(template, skeleton))
    return np.asarray(error.mean(axis=(0, 2)))


def pair_distance_error(pair: Pair, reference: Pair) -> float:
    """Return JPD, metres: mean error of the distances between joints of the two characters."""
    _check_shapes(pair, reference)
    return float(np.abs(_distances(pair) - _distances(reference)).mean())


def contacts_preserved(pair: Pair, template: Pair, limits: RetargetingLimits) -> tuple[int, int]:
    """Count the contacts of the template, over pairs of joints and frames: preserved, and all."""
    touching = _distances(template) < limits.contact_distance
    is_kept = touching & (_distances(pair) < limits.contact_distance + limits.contact_slack)
    return int(is_kept.sum()), int(touching.sum())


def foot_skate(
    pair: Pair, template: Pair, times: Array, body: BodyJoints, limits: RetargetingLimits
) -> Array:
    """Return the summed horizontal speed of feet in stance in the template, m/s, and their count.

    A foot is in stance between two frames if it is less than ``foot_height`` above its lowest
    position in both.
    """
    feet = list(body.feet)
    heights = template[:, :, feet, 1]
    low = heights < heights.min(axis=0) + limits.foot_height
    stance = low[1:] & low[:-1]
    steps = np.linalg.norm(np.diff(pair[:, :, feet][..., [0, 2]], axis=0), axis=-1)
    speeds = steps / np.diff(times)[:, None, None]
    return np.array([speeds[stance].sum(), stance.sum()], dtype=np.float64)


def penetrating_frames(pair: Pair, body: BodyJoints, limits: RetargetingLimits) -> int:
    """Count frames in which points of the two bodies are nearer than ``body_radius``."""
    first, second = (body_points(pair[:, person], body) for person in (0, 1))
    return int((min_point_distance(first, second) < limits.body_radius).sum())


def sample_diversity(samples: NDArray[np.float32]) -> float:
    """Return the mean distance of joints between two samples on one body, metres; 0 for one sample.

    Parameters
    ----------
    samples : (S, T, 2, J, 3)
    """
    if len(samples) < 2:
        return 0.0
    distances = [
        np.linalg.norm(one - other, axis=-1).mean()
        for number, one in enumerate(samples)
        for other in samples[:number]
    ]
    return float(np.mean(distances))


def energy_score(samples: NDArray[np.float32], truth: Pair) -> float:
    """Return the energy score of samples (S, T, 2, J, 3), metres; lower is better.

    The mean distance of joints from the truth, less half that between two different samples
    (Gneiting and Raftery 2007, section 4.3): the error of one motion, rewarded for its spread.
    """
    errors = np.linalg.norm(samples - truth, axis=-1).mean()
    return float(errors) - sample_diversity(samples) / 2


def precision_and_coverage(real: Array, generated: Array, k: int = 5) -> tuple[float, float]:
    """Return which share of generated points lies among real ones, and of real ones is met.

    A point is met by another within the distance of its ``k``-th nearest neighbour among the real
    ones (Naeem et al. 2020). Equal real points count once.

    Parameters
    ----------
    real, generated : (n, D), (m, D)
    """
    real = np.unique(real.round(6), axis=0)
    own = np.linalg.norm(real[:, None] - real[None], axis=-1)
    radius = np.sort(own, axis=1)[:, min(k, len(real) - 1)]
    is_met = np.linalg.norm(real[:, None] - generated[None], axis=-1) <= radius[:, None]
    return float(is_met.any(axis=0).mean()), float(is_met.any(axis=1).mean())


def frechet_distance(real: Array, generated: Array) -> float:
    """Return FID: the Fréchet distance of Gaussians fitted to features (n, D) and (m, D)."""
    return f2id(real[:, :, None], generated[:, :, None], np.ones(1))


def _lengths(pair: Pair, skeleton: Skeleton) -> Array:
    """``(T, 2, E)`` metres."""
    parent, child = skeleton.bones.T
    wide = pair.astype(np.float64)
    lengths: Array = np.linalg.norm(wide[:, :, child] - wide[:, :, parent], axis=-1)
    return lengths


def _distances(pair: Pair) -> NDArray[np.float32]:
    """``(T, J, J)`` metres, from each joint of the first to each of the second."""
    between: NDArray[np.float32] = np.linalg.norm(pair[:, 0, :, None] - pair[:, 1, None], axis=-1)
    return between


def _check_shapes(pair: Pair, other: Pair) -> None:
    if pair.shape != other.shape or pair.ndim != 4 or pair.shape[1] != 2:
        raise ValueError(f"wanted pairs (T, 2, J, 3) of one shape; got {pair.shape}, {other.shape}")


def body_points(motion: Motion, body: BodyJoints) -> Motion:
    """Return the joints and the midpoints of the bones, (T, J + E, 3) metres."""
    return np.concatenate([motion, motion[:, body.bones].mean(axis=2)], axis=1)
