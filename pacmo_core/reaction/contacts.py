"""Contacts that a reaction predicts: near end effectors, and how near they should be.

A generator trained on few clips brings a hand near to the partner's where the two meet, but not as
near as in captured motion: where people are 3 cm apart, it may leave 15 cm. The quantile map of
nearest distances, from generated to captured motion of the training clips, says how near a
generated distance stands for: it maps the nearest tenth of the generated distances to the nearest
tenth of the captured ones, and so on. Distances beyond ``MAX_DISTANCE`` are left as they are, so a
contact that is not predicted is not made.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.interaction import Motion
from pacmo_core.data.skeleton import Skeleton

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

# Metres: distances beyond the second are left alone, those below the first are fully closed.
FULL_DISTANCE, MAX_DISTANCE = 0.35, 0.45
GRID = np.linspace(0, 0.5, 21)  # metres, generated distances at which the map is stored
MIN_FRAMES = 50  # within MAX_DISTANCE, both generated and captured, for a map to be learnt


@dataclass(frozen=True)
class Contacts:
    """Pairs of joints that should be near each other, C of them.

    Parameters
    ----------
    frame, joint : (C,) of the reaction
    point : (C, 3) metres, the partner's joint
    distance : (C,) metres, at most
    strength : (C,) from 0 to 1
    """

    frame: Indices
    joint: Indices
    point: Array
    distance: Array
    strength: Array


def end_effector_groups(skeleton: Skeleton) -> Indices:
    """``(E,)``: a number for each end effector, the same for mirror images: hands, feet, head."""
    mirrored = {right: left for left, right in skeleton.left_right}
    names = [mirrored.get(joint, joint) for joint in skeleton.end_effectors]
    return np.unique(names, return_inverse=True)[1]


def identity_map(skeleton: Skeleton) -> Array:
    """``(2 G, 21)``: the map that leaves all distances of G groups of end effectors as they are."""
    n_groups = int(end_effector_groups(skeleton).max()) + 1
    return np.tile(GRID, (2 * n_groups, 1))


def nearest_joints(
    motion: Motion, other: Motion, skeleton: Skeleton
) -> tuple[NDArray[np.intp], Array]:
    """Return the joint of ``other`` nearest to each end effector of ``motion``, and its distance.

    Returns
    -------
    (T, E) indices, (T, E) metres
    """
    joints, distances = [], []
    for end in skeleton.end_effectors:
        gaps = np.linalg.norm(other - motion[:, end, None], axis=-1)
        joints.append(gaps.argmin(axis=1))
        distances.append(gaps.min(axis=1))
    return np.stack(joints, axis=1), np.stack(distances, axis=1).astype(np.float64)


def learn_contact_map(
    generated: Iterable[tuple[Motion, Motion]],
    captured: Iterable[tuple[Motion, Motion]],
    skeleton: Skeleton,
) -> Array:
    """Learn the quantile map of nearest distances from generated to captured reactions.

    ``Q(d) = F_captured^-1(F_generated(d))`` on ``GRID``, for each group of the reaction's end
    effectors and then of the partner's. Groups that are seldom near the other person keep their
    distances.

    Parameters
    ----------
    generated, captured : pairs of partner and reaction, (T, J, 3) metres each
    skeleton : of both people

    Returns
    -------
    (2 G, 21) metres, not above the identity, ascending
    """
    maps = identity_map(skeleton)
    for row, (ours, theirs) in enumerate(
        zip(
            _pooled_distances(generated, skeleton),
            _pooled_distances(captured, skeleton),
            strict=True,
        )
    ):
        if min((ours < MAX_DISTANCE).sum(), (theirs < MAX_DISTANCE).sum()) >= MIN_FRAMES:
            levels = np.searchsorted(np.sort(ours), GRID, side="right") / len(ours)
            maps[row] = np.minimum(GRID, np.quantile(theirs, levels))
    return maps


def predict_contacts(
    reaction: Motion, partner: Motion, skeleton: Skeleton, contact_map: Array
) -> Contacts:
    """List the contacts that a reaction predicts, of its own end effectors and the partner's.

    Parameters
    ----------
    reaction, partner : (T, J, 3) metres
    skeleton : of both
    contact_map : (2 G, 21) of ``learn_contact_map``
    """
    ends, groups = np.array(skeleton.end_effectors), end_effector_groups(skeleton)
    n_groups = len(contact_map) // 2
    theirs, own_distance = nearest_joints(reaction, partner, skeleton)
    ours, other_distance = nearest_joints(partner, reaction, skeleton)
    own = _contacts(own_distance, contact_map[groups])
    other = _contacts(other_distance, contact_map[n_groups + groups])
    frame = np.concatenate([own[0], other[0]])
    joint = np.concatenate([ends[own[1]], ours[other[:2]]])
    partner_joint = np.concatenate([theirs[own[:2]], ends[other[1]]])
    point = partner[frame, partner_joint].astype(np.float64)
    distance, strength = (np.concatenate([own[i], other[i]]) for i in (2, 3))
    return Contacts(frame, joint, point, distance, strength)


def _contacts(distances: Array, maps: Array) -> tuple[Indices, Indices, Array, Array]:
    """Return frame, end effector, mapped distance and strength of each contact.

    Parameters
    ----------
    distances : (T, E) metres
    maps : (E, 21) metres
    """
    frame, end = np.nonzero(distances < MAX_DISTANCE)
    near = distances[frame, end]
    mapped = np.zeros(len(near))
    for number, row in enumerate(maps):
        mapped[end == number] = np.interp(near[end == number], GRID, row)
    strength = ((MAX_DISTANCE - near) / (MAX_DISTANCE - FULL_DISTANCE)).clip(0, 1)
    return frame, end, np.minimum(near, mapped), strength


def _pooled_distances(pairs: Iterable[tuple[Motion, Motion]], skeleton: Skeleton) -> list[Array]:
    """Return the nearest distances of the groups of the reaction, then of the partner's."""
    groups = end_effector_groups(skeleton)
    own, other = [], []
    for partner, reaction in pairs:
        own.append(nearest_joints(reaction, partner, skeleton)[1])
        other.append(nearest_joints(partner, reaction, skeleton)[1])
    return [
        np.concatenate(distances)[:, groups == group].ravel()
        for distances in (own, other)
        for group in range(int(groups.max()) + 1)
    ]
