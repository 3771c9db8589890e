"""What commands say of a motion: bones that turn fast, jolts; of a reaction also feet and depth.

Of the motion as it is in the files. No captured reaction is needed: feet and turns are compared
with the partner's, the rest with limits that captured people keep. Means and percentiles over time
hide a jump in one frame, which everybody sees: bones and joints are named with frame and time.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from pacmo_core.data.interaction import Motion
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.figures.numbers import format_fixed
from pacmo_core.formats.registry import PersonMotion
from pacmo_core.interaction_mesh.capsules import penetration_depths
from pacmo_core.interaction_mesh.scene import Scene
from pacmo_core.metrics.plausibility import find_body_joints

# Metres per second squared, of a joint: 99 of 100 captured motions of the default stay below.
MAX_ACCELERATION = 150.0
# Metres: a shorter bone turns by much where its ends hardly move.
MIN_BONE = 0.02
# Metres: the bodies are modelled as capsules, and captured hugs are up to 8 cm deep.
MAX_DEPTH = 0.08
# Metres per second: the mean speed of the slower foot, 99 of 100 captured motions are below 28.5
# cm/s.
MAX_GLIDE = 0.3
# Seconds, standard deviation of the kernel by which ankles are smoothed.
SMOOTHING = 0.1
MAX_LINES = 8

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Peak:
    """Where a measured value is greatest.

    Parameters
    ----------
    row, column : in the measured array
    joint : that accelerates, or at the end of the bone that turns
    frame : from 0; of a turn the second of the two frames
    time : seconds after the first frame
    """

    row: int
    column: int
    joint: str
    frame: int
    time: float

    @property
    def place(self) -> str:
        """Frame and time, in words."""
        return f"in frame {self.frame} ({self.time:.2f} s)"


def find_peak(values: Array, joints: tuple[str, ...], times: Array) -> Peak:
    """Find the greatest of ``bone_turns``, ``joint_accelerations`` or differences of these.

    Parameters
    ----------
    values : (T - 1, E) or (T - 2, J)
    joints : the name of each column
    times : (T,) seconds
    """
    row, column = (int(i) for i in np.unravel_index(values.argmax(), values.shape))
    return Peak(row, column, joints[column], row + 1, float(times[row + 1] - times[0]))


def bone_turns(skeleton: Skeleton, motion: Motion) -> Array:
    """Return the turn of each bone from a frame to the next, ``(T - 1, E)`` degrees.

    Bones that are shorter than 2 cm have no turn.
    """
    ends = motion[:, skeleton.bones].astype(np.float64)
    bones = ends[:, :, 1] - ends[:, :, 0]
    sine = np.linalg.norm(np.cross(bones[:-1], bones[1:]), axis=-1)
    turns = np.degrees(np.arctan2(sine, (bones[:-1] * bones[1:]).sum(axis=-1)))
    is_long = np.linalg.norm(bones, axis=-1).min(axis=0) >= MIN_BONE
    return np.where(is_long, turns, 0.0)


def bone_names(skeleton: Skeleton) -> tuple[str, ...]:
    """Return the joint at the end of each bone."""
    return tuple(skeleton.joints[child] for child in skeleton.bones[:, 1].tolist())


def joint_accelerations(times: Array, motion: Motion) -> Array:
    """Return the acceleration of each joint between neighbouring frames, ``(T - 2, J)`` m/s²."""
    steps = np.diff(times)[:, None, None]
    velocity = np.diff(motion.astype(np.float64), axis=0) / steps
    change = np.diff(velocity, axis=0) / ((steps[1:] + steps[:-1]) / 2)
    accelerations: Array = np.linalg.norm(change, axis=-1)
    return accelerations


def motion_lines(
    skeleton: Skeleton,
    times: Array,
    partner: Motion,
    samples: Motion,
    people: Sequence[PersonMotion],
) -> list[str]:
    """Return a line of all samples, and one for each sample that people would not move like.

    Parameters
    ----------
    times : (T,) seconds, evenly spaced
    partner, samples : (T, J, 3) and (S, T, J, 3) metres
    people : the partner and each sample with all joints of their files, whose bones turn
    """
    parts, faults = [], []
    if ankles := list(find_body_joints(skeleton).ankles):
        glides = [100 * _glide(sample[:, ankles], times) for sample in samples]
        own = format_fixed(100 * _glide(partner[:, ankles], times), 1)
        limit = f"wanted at most {100 * MAX_GLIDE:.0f} cm/s"
        parts.append(
            f"the slower foot moves at {_range(glides, 1)} cm/s on average, {limit} (the partner's "
            f"at {own})"
        )
        faults += [
            f"sample {number}: the slower foot moves at {format_fixed(glide, 1)} cm/s on average, "
            f"{limit}"
            for number, glide in enumerate(glides)
            if glide > 100 * MAX_GLIDE
        ]
    try:
        depths = [_depths(skeleton, times, partner, sample) for sample in samples]
    except ValueError as fault:
        parts.append(f"how deep the bodies are in each other is not measured ({fault})")
    else:
        deepest = [100 * max(0.0, float(depth.max())) for depth in depths]
        parts.append(f"the bodies are at most {_range(deepest, 1)} cm deep in each other")
        faults += [
            f"sample {number}: the bodies are {format_fixed(most, 1)} cm deep in each other at "
            f"{times[depth.argmax()]:.2f} s, wanted at most {100 * MAX_DEPTH:.0f} cm"
            for number, (most, depth) in enumerate(zip(deepest, depths, strict=True))
            if most > 100 * MAX_DEPTH
        ]
    accelerations = [joint_accelerations(times, sample) for sample in samples]
    peaks = [float(of_sample.max(initial=0.0)) for of_sample in accelerations]
    parts.append(f"joints accelerate by at most {_range(peaks, 0)} m/s²")
    for number, of_sample in enumerate(accelerations):
        if peaks[number] > MAX_ACCELERATION:
            peak = find_peak(of_sample, skeleton.joints, times)
            faults.append(
                f"sample {number} has a jolt: {peak.joint} accelerates by {peaks[number]:.0f} m/s² "
                f"{peak.place}, wanted at most {MAX_ACCELERATION:.0f}"
            )
    parts.append(_turn_text(times, people))
    if len(faults) > MAX_LINES:
        faults[MAX_LINES:] = [f"and {len(faults) - MAX_LINES} more of this kind"]
    hint = ["another --seed gives other samples"] if faults else []
    return [f"the motion of the reaction: {'; '.join(parts)}", *faults, *hint]


def _turn_text(times: Array, people: Sequence[PersonMotion]) -> str:
    """Say which bone of all samples turns most between two frames, beside the partner's most."""
    partner, *samples = (bone_turns(person.skeleton, person.motion) for person in people)
    number = max(range(len(samples)), key=lambda n: samples[n].max())
    peak = find_peak(samples[number], bone_names(people[1 + number].skeleton), times)
    of_sample = f" of sample {number}" if len(samples) > 1 else ""
    return (
        f"the bone to {peak.joint} turns most from one frame to the next, by "
        f"{format_fixed(samples[number].max(), 1)}° {peak.place}{of_sample} (the partner's most: "
        f"{format_fixed(partner.max(), 1)}°)"
    )


def _range(values: list[float], decimals: int) -> str:
    """Format one value, or the least and the greatest."""
    low, high = (format_fixed(value, decimals) for value in (min(values), max(values)))
    return low if low == high else f"{low} to {high}"


def _glide(ankles: Motion, times: Array) -> float:
    """Return the mean horizontal speed of the slower ankle in metres per second."""
    step = (times[-1] - times[0]) / (len(times) - 1)
    path = gaussian_filter1d(ankles[..., [0, 2]].astype(np.float64), SMOOTHING / step, axis=0)
    speeds = np.linalg.norm(np.diff(path, axis=0), axis=-1) / step
    return float(speeds.min(axis=1).mean())


def _depths(skeleton: Skeleton, times: Array, partner: Motion, sample: Motion) -> Array:
    """``(T,)`` metres."""
    fps = (len(times) - 1) / (times[-1] - times[0])
    return penetration_depths(Scene((partner, sample), (skeleton, skeleton), fps))
