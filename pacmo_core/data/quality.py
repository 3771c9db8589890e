"""Quality of a capture: what is measured, and the limits beyond which it is not used."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.interaction import Interaction, Motion, bone_lengths, min_joint_distance
from pacmo_core.data.skeleton import Skeleton

# Metres. Formats have bones of zero length, whose relative variation is undefined.
_MIN_BONE_LENGTH = 1e-3


class QualityError(ValueError):
    """A capture that was read without error and exceeds quality limits.

    Parameters
    ----------
    violations : as ``limit_violations`` lists them
    """

    def __init__(self, violations: list[str]) -> None:
        self.violations = violations
        super().__init__("; ".join(violations))

    def __reduce__(self) -> tuple[type["QualityError"], tuple[list[str]]]:
        """Pickle the list; by default an exception is rebuilt from its message."""
        return QualityError, (self.violations,)


@dataclass(frozen=True, kw_only=True)
class Quality:
    """Measurements of a capture that do not depend on what it shows.

    Parameters
    ----------
    n_frames : frames
    fps : frames a second, the inverse of the median time between frames
    rate_jitter : the largest deviation of a time between frames from the median, relative to it
    bone_length_variation : standard deviation over mean of a bone's length over time, median over
        bones, maximum of the two people; inf for a body without extent
    max_joint_speed : m/s, of any joint between any two frames
    max_body_speed : m/s, the same of the median joint: half of the body moves at least as fast
    min_joint_distance : metres, from any joint of one person to any of the other in any frame
    contact_share : share of frames with two joints within the contact distance
    person_distance : metres from a joint of one person to the same joint of the other, mean
    fastest_joint, fastest_body : whose the two speeds are and when, in words
    """

    n_frames: int
    fps: float
    rate_jitter: float
    bone_length_variation: float
    max_joint_speed: float
    max_body_speed: float
    min_joint_distance: float
    contact_share: float
    person_distance: float
    fastest_joint: str = field(default="", compare=False)
    fastest_body: str = field(default="", compare=False)


@dataclass(frozen=True, kw_only=True)
class QualityLimits:
    """Limits of the fields of ``Quality``.

    Parameters
    ----------
    min_frames : frames
    max_rate_jitter : share of the median time between frames
    max_rate_error : share of the stated rate by which the times in the file may differ from it
    max_bone_length_variation : share of a bone's length
    max_joint_speed, max_body_speed : m/s
    min_person_distance : metres; less is one body twice
    """

    min_frames: int
    max_rate_jitter: float
    max_rate_error: float
    max_bone_length_variation: float
    max_joint_speed: float
    max_body_speed: float
    min_person_distance: float


def measure_quality(interaction: Interaction, *, contact_distance: float) -> Quality:
    """Measure a capture; joints within ``contact_distance`` metres of each other touch."""
    people = (interaction.person_a, interaction.person_b)
    steps = np.diff(interaction.times)
    speeds = np.stack([_speeds(motion, steps) for motion in people])
    body_speeds = np.median(speeds, axis=2)
    person, frame, joint = np.unravel_index(speeds.argmax(), speeds.shape)
    whose, when = np.unravel_index(body_speeds.argmax(), body_speeds.shape)
    name, times = interaction.skeleton.joints[joint], interaction.times
    closest = min_joint_distance(interaction)
    same_joint = np.linalg.norm(people[0] - people[1], axis=-1)
    return Quality(
        n_frames=len(interaction.times),
        fps=interaction.fps,
        rate_jitter=float(np.abs(steps / np.median(steps) - 1).max()),
        bone_length_variation=max(_length_variation(m, interaction.skeleton) for m in people),
        max_joint_speed=float(speeds.max()),
        max_body_speed=float(body_speeds.max()),
        min_joint_distance=float(closest.min()),
        contact_share=float((closest <= contact_distance).mean()),
        person_distance=float(same_joint.mean()),
        fastest_joint=f"{name} of person {'ab'[person]} at {times[frame]:.2f} s",
        fastest_body=f"person {'ab'[whose]} at {times[when]:.2f} s",
    )


def limit_violations(
    quality: Quality, limits: QualityLimits, stated_fps: float | None = None
) -> list[str]:
    """List the limits that a capture exceeds, in words; empty if it is good.

    Parameters
    ----------
    quality, limits : measurements and their limits
    stated_fps : the rate that the dataset documents, where the times come from the file instead
    """
    checks = [
        (
            quality.n_frames < limits.min_frames,
            f"{quality.n_frames} frames, wanted at least {limits.min_frames}",
        ),
        (
            quality.rate_jitter > limits.max_rate_jitter,
            f"times between frames deviate from their median by {quality.rate_jitter:.0%}, "
            f"wanted at most {limits.max_rate_jitter:.0%}",
        ),
        (
            quality.bone_length_variation > limits.max_bone_length_variation,
            f"bones change in length by {quality.bone_length_variation:.0%}, "
            f"wanted at most {limits.max_bone_length_variation:.0%}",
        ),
        (
            quality.max_joint_speed > limits.max_joint_speed,
            f"a joint jumps at {quality.max_joint_speed:.1f} m/s ({quality.fastest_joint}), "
            f"wanted at most {limits.max_joint_speed:.1f}",
        ),
        (
            quality.max_body_speed > limits.max_body_speed,
            f"a body jumps at {quality.max_body_speed:.1f} m/s ({quality.fastest_body}), "
            f"wanted at most {limits.max_body_speed:.1f}",
        ),
        (
            quality.person_distance < limits.min_person_distance,
            f"the same body twice: joints {quality.person_distance:.3f} m from their counterparts "
            f"on average, wanted at least {limits.min_person_distance:.3f}",
        ),
        (
            stated_fps is not None and abs(quality.fps / stated_fps - 1) > limits.max_rate_error,
            f"the file's own times give {quality.fps:.4g} frames a second, wanted {stated_fps}",
        ),
    ]
    return [message for is_violation, message in checks if is_violation]


def check_quality(quality: Quality, limits: QualityLimits, stated_fps: float | None = None) -> None:
    """Refuse a capture that exceeds limits.

    Raises
    ------
    QualityError
        With all ``limit_violations``.
    """
    violations = limit_violations(quality, limits, stated_fps)
    if violations:
        raise QualityError(violations)


def _speeds(motion: Motion, steps: NDArray[np.float64]) -> NDArray[np.float64]:
    """``(T - 1, J)`` m/s."""
    paths: NDArray[np.float64] = np.linalg.norm(np.diff(motion, axis=0), axis=-1)
    return paths / steps[:, None]


def _length_variation(motion: Motion, skeleton: Skeleton) -> float:
    lengths = bone_lengths(motion, skeleton).astype(np.float64)
    mean = lengths.mean(axis=0)
    measurable = mean > _MIN_BONE_LENGTH
    if not measurable.any():
        return float("inf")
    return float(np.median(lengths[:, measurable].std(axis=0) / mean[measurable]))
