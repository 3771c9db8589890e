"""Plausibility of reactions: feet, steps, ground, bones, jerk, jolts, lurches; distances over time.

The joints that these metrics use (root, feet, hands, head, shoulders) are found by name in any
skeleton.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.segments import shoulders
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.metrics.bootstrap import Array
from pacmo_core.metrics.reactions import Reactions, to_length

# The first word that names a joint on both sides applies; datasets have different joints.
_FEET = ("foot", "toe", "ankle", "heel")
_ANKLES = ("ankle", *_FEET)
_HANDS = ("hand", "wrist")


@dataclass(frozen=True)
class BodyJoints:
    """The joints of a skeleton that the metrics use.

    Parameters
    ----------
    root : index of the root joint
    keys : indices of the joints whose distances between two bodies are compared
    feet : indices of the foot joints; empty if no joint has such a name
    ankles : of the ankles; the feet if no joint has such a name
    bones : (E, 2) indices, parent and child
    shoulders : where upper arms begin; empty if no arm has a name
    """

    root: int
    keys: tuple[int, ...]
    feet: tuple[int, ...]
    ankles: tuple[int, ...]
    bones: NDArray[np.intp]
    shoulders: tuple[int, ...]


def find_body_joints(skeleton: Skeleton) -> BodyJoints:
    """Find root, head, hands and feet by name; if one is missing, all joints are keys."""
    feet, hands = _left_and_right(skeleton, _FEET), _left_and_right(skeleton, _HANDS)
    head = tuple(i for i, name in enumerate(skeleton.joints) if "head" in name.lower())[:1]
    named = sorted({skeleton.root, *head, *hands, *feet})
    complete = bool(head and hands and feet)
    keys = tuple(named) if complete else tuple(range(len(skeleton.joints)))
    return BodyJoints(
        root=skeleton.root,
        keys=keys,
        feet=feet,
        ankles=_left_and_right(skeleton, _ANKLES),
        bones=skeleton.body_bones,
        shoulders=shoulders(skeleton),
    )


def _left_and_right(skeleton: Skeleton, words: tuple[str, ...]) -> tuple[int, ...]:
    """Find the end joints of left and right limbs by the first word that matches any."""
    paired = sorted({joint for pair in skeleton.left_right for joint in pair})
    for word in words:
        joints = tuple(i for i in paired if word in skeleton.joints[i].lower())
        if joints:
            return joints
    return ()


WALKING_SPEED = 0.5  # metres per second, of the root over the ground
# A lurch is there and back within twice this, seconds; real ones are small but for this share.
LURCH_SECONDS, REAL_LURCHES = 1 / 6, 0.05
# Quantile of the foot heights of a real clip that is its ground; lower ones are noise.
GROUND_TOLERANCE = 0.05


def foot_skate(row: Reactions, body: BodyJoints, *, smoothing: float) -> Array:
    """Return the summed speed of the slower ankle, m/s, and the number of frames, (2, n).

    In walking and standing one foot rests, so that the horizontal speed of the slower ankle is that
    of a foot that glides. Positions are smoothed first: the noise of a depth camera alone moves a
    resting ankle by centimetres from frame to frame, at half a metre a second.

    Parameters
    ----------
    smoothing : seconds, standard deviation of the Gaussian by which positions are smoothed
    """
    ankles = list(body.ankles)
    sums = []
    for motion, times in zip(row.motions, row.times, strict=True):
        path = smooth(motion[:, ankles][..., [0, 2]], times, smoothing)
        speed = np.linalg.norm(np.gradient(path, times, axis=0), axis=-1).min(axis=1)
        sums.append((speed.sum(), len(speed)))
    return np.array(sums, dtype=np.float64).T


def step_length(row: Reactions, body: BodyJoints, *, smoothing: float) -> Array:
    """Return the summed distances of the ankles along the way, and the frames of walks, (2, n).

    Where a body walks, one foot is ahead and the other behind. In the mean of many gaits both are
    beneath the body, and its legs shuffle. Positions are smoothed as for ``foot_skate``.
    """
    sums = []
    for motion, times in zip(row.motions, row.times, strict=True):
        path = smooth(motion[:, [body.root, *body.ankles]][..., [0, 2]], times, smoothing)
        velocity = np.gradient(path[:, 0], times, axis=0)
        speed = np.linalg.norm(velocity, axis=-1)
        walks = speed > WALKING_SPEED
        along = (path[walks, 1:] * velocity[walks, None] / speed[walks, None, None]).sum(axis=-1)
        sums.append(((along.max(axis=1) - along.min(axis=1)).sum(), walks.sum()))
    return np.array(sums, dtype=np.float64).T


def ground_penetration(row: Reactions, real: Reactions, body: BodyJoints) -> Array:
    """Return the summed depth of the lowest joint below the ground, and the frames, (2, n).

    The ground is that of the real reaction in the same clip: a low quantile of the heights of its
    feet. Noise gives captured motion a depth too.
    """
    feet = list(body.feet)
    sums = []
    for motion, real_motion in zip(row.motions, real.motions, strict=True):
        ground = np.quantile(real_motion[:, feet, 1], GROUND_TOLERANCE)
        depth = (ground - motion[..., 1].min(axis=1)).clip(min=0)
        sums.append((depth.sum(), len(depth)))
    return np.array(sums, dtype=np.float64).T


def bone_variation(row: Reactions, body: BodyJoints) -> Array:
    """Return the summed coefficients of variation of the bone lengths, and their number, (2, n).

    The coefficient is the standard deviation over time by the mean, of each bone of a reaction.
    """
    sums = []
    for motion in row.motions:
        ends = motion[:, body.bones].astype(np.float64)  # (T, E, 2, 3)
        lengths = np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=-1)
        means = lengths.mean(axis=0)
        present = means > 0  # some formats put two joints into one place
        sums.append(((lengths.std(axis=0)[present] / means[present]).sum(), present.sum()))
    return np.array(sums, dtype=np.float64).T


def jerk(row: Reactions, *, smoothing: float) -> Array:
    """Return the summed third derivatives of joint positions, m/s³, and their number, (2, n).

    Positions are smoothed as for ``foot_skate``, as the jerk of captured motion is otherwise that
    of the camera's noise.
    """
    sums = []
    for motion, times in zip(row.motions, row.times, strict=True):
        derivative = smooth(motion, times, smoothing)
        for _ in range(3):
            derivative = np.gradient(derivative, times, axis=0)
        # One-sided differences at the ends err by the inverse of the time step.
        inner = slice(3, -3) if len(times) > 6 else slice(None)
        size = np.linalg.norm(derivative[inner], axis=-1)
        sums.append((size.sum(), size.size))
    return np.array(sums, dtype=np.float64).T


def jolts(row: Reactions, real: Reactions) -> Array:
    """Return which reactions have a jolt, 0 or 1, and ones, (2, n).

    A jolt is an acceleration of a joint that is greater than all of the real reactions. Means over
    time hide it: a knee that jumps in one frame of a thousand is seen, and changes no mean.
    """
    most = max(peak_acceleration(*motion) for motion in zip(real.motions, real.times, strict=True))
    peaks = [peak_acceleration(*motion) for motion in zip(row.motions, row.times, strict=True)]
    return np.array([[peak > most for peak in peaks], np.ones(len(peaks))], dtype=np.float64)


def peak_acceleration(motion: NDArray[np.float32], times: Array) -> float:
    """Return the greatest acceleration of a joint between neighbouring frames, m/s²; 0 of two.

    Parameters
    ----------
    motion : (T, J, 3) metres
    times : (T,) seconds
    """
    steps = np.diff(times)[:, None, None]
    velocity = np.diff(motion.astype(np.float64), axis=0) / steps
    change = np.diff(velocity, axis=0) / ((steps[1:] + steps[:-1]) / 2)
    return float(np.linalg.norm(change, axis=-1).max(initial=0.0))


def lurches(row: Reactions, real: Reactions, body: BodyJoints, *, smoothing: float) -> Array:
    """Return which reactions lurch, 0 or 1, and ones, (2, n).

    A lurch is a trunk that leans away and comes back within a third of a second, or a pelvis that
    sinks or rises and comes back, farther than those of 95 % of the real reactions. No mean over
    joints and time shows it: eyes do. Positions are smoothed as for ``foot_skate``.
    """
    sizes = [
        np.array([_lurch(m, t, body, smoothing) for m, t in zip(s.motions, s.times, strict=True)])
        for s in (row, real)
    ]
    limits = np.quantile(sizes[1], 1 - REAL_LURCHES, axis=0)
    return np.array([(sizes[0] > limits).any(axis=1), np.ones(len(row))], dtype=np.float64)


def _lurch(motion: NDArray[np.float32], times: Array, body: BodyJoints, width: float) -> Array:
    """Return the largest lurch of a trunk, of its unit vector, and of a pelvis, metres; (2,)."""
    inner = times[(times >= times[0] + LURCH_SECONDS) & (times <= times[-1] - LURCH_SECONDS)]
    if not len(inner):
        return np.zeros(2)
    path = smooth(motion[:, [body.root, *body.shoulders]], times, width)
    trunk = path[:, 1:].mean(axis=1) - path[:, 0]
    length = np.maximum(np.linalg.norm(trunk, axis=-1, keepdims=True), 1e-9)
    values = np.concatenate([trunk / length, path[:, 0, 1:2]], axis=1)
    before, now, after = (
        np.stack([np.interp(inner + shift, times, column) for column in values.T], axis=1)
        for shift in (-LURCH_SECONDS, 0.0, LURCH_SECONDS)
    )
    off = now - (before + after) / 2
    return np.array([np.linalg.norm(off[:, :3], axis=1).max(), np.abs(off[:, 3]).max()])


def smooth(values: NDArray[np.float32], times: Array, width: float) -> Array:
    """Smooth over time by a Gaussian kernel, normalised at the ends, (T, ...) float64.

    Parameters
    ----------
    values : (T, ...)
    times : (T,) seconds
    width : seconds, standard deviation of the kernel
    """
    kernel = np.exp(-0.5 * ((times[:, None] - times) / width) ** 2)
    kernel /= kernel.sum(axis=1, keepdims=True)
    return np.tensordot(kernel, values.astype(np.float64), axes=1)


def distance_functions(row: Reactions, body: BodyJoints, n_instants: int) -> Array:
    """Return the distances from each key joint of the partner to each of the reaction over time.

    They depend on the pairing of reactions and partners.

    Returns
    -------
    (n, K², r) metres, at r equally spaced times
    """
    keys = list(body.keys)
    result = []
    for partner, motion, times in zip(row.partners, row.motions, row.times, strict=True):
        gaps = np.linalg.norm(partner[:, keys, None] - motion[:, None, keys], axis=-1)
        flat = gaps.reshape(len(times), -1, 1)
        result.append(to_length(flat, times, n_instants)[:, :, 0].T)
    return np.stack(result)


@dataclass(frozen=True)
class PrincipalComponents:
    """The principal components of distances between bodies in real training data.

    The bias of F²ID for few samples grows with the square of the dimension, and K² functions at r
    times are many; their principal components are few.

    Parameters
    ----------
    mean : (K², 1) metres
    scale : (K², 1) metres
    axes : (K²·r, k), orthonormal
    """

    mean: Array
    scale: Array
    axes: Array

    def coordinates(self, functions: Array) -> Array:
        """Return the coordinates of (n, K², r) functions, (n, k), in units of L²(time)."""
        flat = ((functions - self.mean) / self.scale).reshape(len(functions), -1)
        return np.asarray(flat @ self.axes / np.sqrt(functions.shape[-1]))


def fit_principal_components(functions: Array, n_components: int) -> PrincipalComponents:
    """Fit at most ``n_components`` components to standardised functions (n, K², r)."""
    mean = functions.mean(axis=(0, 2))[:, None]
    scale = functions.std(axis=(0, 2))[:, None]
    if not (scale > 0).all():
        raise ValueError("wanted distances that vary; one is the same in all real training data")
    flat = ((functions - mean) / scale).reshape(len(functions), -1)
    _, lengths, axes = np.linalg.svd(flat - flat.mean(axis=0), full_matrices=False)
    resolved = lengths > lengths[0] * np.finfo(np.float64).eps * max(flat.shape)
    return PrincipalComponents(mean, scale, axes[: min(n_components, int(resolved.sum()))].T)
