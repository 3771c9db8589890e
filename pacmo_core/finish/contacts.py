"""Contacts that a reaction predicts: pairs of joints that held-out motion says should touch.

A generator brings a hand near to the partner's where the two meet, but not as near as in captured
motion, and it leaves hands near each other where they only pass. Two numbers tell these apart: the
distance of two joints, and the speed at which one moves relative to the other. For each kind of
pair a logistic regression on both gives the probability that the captured joints are in contact. It
is fitted on reactions to partners that the model was not trained on. A pair that is likely in
contact is closed to the distance that captured contacts seldom exceed. No other is, so that a
contact that is not predicted is not made.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from pacmo_core.data.interaction import Motion
from pacmo_core.data.skeleton import Skeleton

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

MAX_DISTANCE = 0.45  # metres, beyond which no contact is predicted
CONTACT_DISTANCE = 0.1  # metres between end effectors in contact
# Metres from an end effector to a joint inside the other's body when their skins are in contact: a
# fist's half width and a trunk's or an upper arm's radius.
BODY_CONTACT_DISTANCE = 0.18
SMOOTHING = 0.08  # seconds, standard deviation of the filter on paths whose speed is taken
# Probabilities at which a contact begins to be closed, and is closed entirely. With 0.3 and 0.5
# reactions to SBU's partners met 2.5 % more contacts at 1 % more false ones, and those to synthetic
# ones 0.4 % at 0.1 % more, at a lower F1, in earlier versions (docs/results_details.md).
LEAST_PROBABILITY, FULL_PROBABILITY = 0.4, 0.6
WANTED_SHARE = 0.75  # of captured contacts that are as near as a contact is closed
MIN_FRAMES = 50  # within MAX_DISTANCE, in contact and not, for a kind of pair to be learnt
RIDGE = 1e-3  # on the coefficients of the regression
N_NEWTON_STEPS = 30
NEVER = -100.0  # intercept of a kind of pair that is not learnt


@dataclass(frozen=True)
class Pairs:
    """Pairs of joints of the reaction and the partner over time, P of them.

    Parameters
    ----------
    kind : (P,) rows of the contact model
    joint, partner_joint : (T, P) of the reaction and of the partner
    distance : (T, P) metres
    speed : (T, P) metres per second, of one joint relative to the other
    """

    kind: Indices
    joint: Indices
    partner_joint: Indices
    distance: Array
    speed: Array


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


def no_contacts(skeleton: Skeleton) -> Array:
    """``(G^2 + 2 G, 4)``: the contact model that predicts none, of G groups of end effectors."""
    n_groups = int(end_effector_groups(skeleton).max()) + 1
    return np.tile([NEVER, 0, 0, MAX_DISTANCE], (n_groups**2 + 2 * n_groups, 1))


def find_pairs(reaction: Motion, partner: Motion, fps: float, skeleton: Skeleton) -> Pairs:
    """List the pairs that can be in contact.

    These are every end effector of one with every of the other, then each of the reaction's with
    the nearest other joint of the partner, and each of the partner's with that of the reaction.

    Parameters
    ----------
    reaction, partner : (T, J, 3) metres
    fps : frames per second
    skeleton : of both
    """
    ends, groups = np.array(skeleton.end_effectors), end_effector_groups(skeleton)
    n_frames, n_groups = len(reaction), int(groups.max()) + 1
    inner = np.setdiff1d(np.arange(len(skeleton.joints)), ends)
    own, theirs = (np.tile(grid.ravel(), (n_frames, 1)) for grid in np.meshgrid(ends, ends))
    fixed = np.tile(ends, (n_frames, 1))
    joint = np.hstack([own, fixed, nearest_joints(partner[:, ends], reaction, inner)])
    partner_joint = np.hstack([theirs, nearest_joints(reaction[:, ends], partner, inner), fixed])
    own_group, their_group = (grid.ravel() for grid in np.meshgrid(groups, groups))
    first = n_groups**2
    kind = np.concatenate(
        [n_groups * own_group + their_group, first + groups, first + n_groups + groups]
    )
    frames = np.arange(n_frames)[:, None]
    gap = reaction[frames, joint] - partner[frames, partner_joint]
    relative = (
        _velocity(reaction, fps)[frames, joint] - _velocity(partner, fps)[frames, partner_joint]
    )
    distance, speed = (np.linalg.norm(v, axis=-1).astype(np.float64) for v in (gap, relative))
    return Pairs(kind, joint, partner_joint, distance, speed)


def nearest_joints(points: Motion, motion: Motion, among: Indices) -> Indices:
    """Return which joints of a motion are nearest to points.

    Parameters
    ----------
    points : (T, N, 3) metres
    motion : (T, J, 3) metres
    among : joints of the motion

    Returns
    -------
    (T, N) indices
    """
    gaps = np.linalg.norm(motion[:, None, among] - points[:, :, None], axis=-1)
    nearest: Indices = among[gaps.argmin(axis=2)]
    return nearest


def learn_contacts(pairs: Iterable[tuple[Pairs, Pairs]], skeleton: Skeleton) -> Array:
    """Fit the probability of contact of each kind of pair, by logistic regression.

    Parameters
    ----------
    pairs : of generated reactions, and of the captured reaction to the same partner
    skeleton : of both people

    Returns
    -------
    (G^2 + 2 G, 4): intercept, coefficients of distance (1/m) and speed (s/m), metres between joints
    in contact. Kinds that are seldom in contact, or never without, are never.
    """
    model, rows = no_contacts(skeleton), []
    for generated, captured in pairs:
        near = generated.distance < MAX_DISTANCE
        kind = np.broadcast_to(generated.kind, near.shape)
        table = (kind, generated.distance, generated.speed, captured.distance)
        rows.append(np.stack([column[near] for column in table], axis=1))
    samples = np.concatenate(rows) if rows else np.zeros((0, 4))
    n_end_kinds = (int(end_effector_groups(skeleton).max()) + 1) ** 2
    for row in range(len(model)):
        distance, speed, wanted = samples[samples[:, 0] == row, 1:].T
        touching = wanted < (CONTACT_DISTANCE if row < n_end_kinds else BODY_CONTACT_DISTANCE)
        if min(touching.sum(), (~touching).sum()) >= MIN_FRAMES:
            features = np.stack([np.ones(len(distance)), distance, speed], axis=1)
            coefficients = _fit_logistic(features, touching.astype(np.float64))
            if coefficients[1] < 0:  # else a generated distance says nothing of the captured one
                model[row] = [*coefficients, np.quantile(wanted[touching], WANTED_SHARE)]
    return model


def predict_contacts(
    reaction: Motion, partner: Motion, fps: float, skeleton: Skeleton, contact_model: Array
) -> Contacts:
    """List the contacts that a reaction predicts.

    Parameters
    ----------
    reaction, partner : (T, J, 3) metres
    fps : frames per second
    skeleton : of both
    contact_model : of ``learn_contacts``
    """
    pairs = find_pairs(reaction, partner, fps, skeleton)
    intercept, of_distance, of_speed, wanted = contact_model[pairs.kind].T
    score = intercept + of_distance * pairs.distance + of_speed * pairs.speed
    probability = 1 / (1 + np.exp(-score.clip(-50, 50)))
    strength = (probability - LEAST_PROBABILITY) / (FULL_PROBABILITY - LEAST_PROBABILITY)
    strength = np.where(pairs.distance < MAX_DISTANCE, strength.clip(0, 1), 0)
    frame, pair = np.nonzero(strength)
    partner_joint, near = pairs.partner_joint[frame, pair], pairs.distance[frame, pair]
    chosen = strength[frame, pair]
    target = near - chosen * np.maximum(near - wanted[pair], 0)
    point = partner[frame, partner_joint].astype(np.float64)
    return Contacts(frame, pairs.joint[frame, pair], point, target, chosen)


def _velocity(motion: Motion, fps: float) -> Array:
    """``(T, J, 3)`` metres per second, of smoothed paths."""
    if len(motion) < 2:
        return np.zeros(motion.shape)
    smooth = gaussian_filter1d(motion.astype(np.float64), SMOOTHING * fps, axis=0, mode="nearest")
    return np.asarray(np.gradient(smooth, 1 / fps, axis=0))


def _fit_logistic(features: Array, labels: Array) -> Array:
    """Maximise the likelihood of labels 0 and 1 by Newton's method."""
    weights = np.zeros(features.shape[1])
    penalty = RIDGE * np.eye(len(weights))
    for _ in range(N_NEWTON_STEPS):
        probability = 1 / (1 + np.exp(-(features @ weights).clip(-50, 50)))
        curvature = features.T @ (features * (probability * (1 - probability))[:, None])
        gradient = features.T @ (labels - probability) - penalty @ weights
        weights = weights + np.linalg.solve(curvature + penalty, gradient)
    return weights
