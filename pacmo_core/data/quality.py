"""How good a capture is, and when it is too bad to use."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.interaction import Interaction, Motion, bone_lengths, min_joint_distance
from pacmo_core.data.skeleton import Skeleton

# Metres. Formats have bones of no length at all, which cannot vary in proportion to it.
_SHORTEST_BONE = 1e-3


class QualityError(ValueError):
    """A capture that reads well and is no record of two people; ``faults`` says why not."""

    def __init__(self, faults: list[str]) -> None:
        self.faults = faults
        super().__init__("; ".join(faults))

    def __reduce__(self) -> tuple[type["QualityError"], tuple[list[str]]]:
        """Cross process boundaries with the list, not with the message in its place."""
        return QualityError, (self.faults,)


@dataclass(frozen=True, kw_only=True)
class Quality:
    """What can be said of a capture without knowing what it shows.

    Parameters
    ----------
    n_frames : frames
    fps : frames a second, the inverse of the median time between frames
    rate_jitter : the largest departure of a time between frames from the median, as a share of it
    bone_length_variation : standard deviation by mean of a bone's length over time, the median
        over bones, the worse of the two people; inf for a body without extent
    max_joint_speed : m/s, of any joint between any two frames
    max_body_speed : m/s, the same of the median joint: half of the body moves at least so fast
    min_joint_distance : metres, from any joint of one person to any of the other in any frame
    contact_share : of the frames, those with two joints within the contact distance
    apart : metres from a joint of one person to the same joint of the other, the mean
    """

    n_frames: int
    fps: float
    rate_jitter: float
    bone_length_variation: float
    max_joint_speed: float
    max_body_speed: float
    min_joint_distance: float
    contact_share: float
    apart: float


@dataclass(frozen=True, kw_only=True)
class QualityLimits:
    """Where a capture becomes too bad; the fields bound those of ``Quality``.

    Parameters
    ----------
    min_frames : frames
    max_rate_jitter : share of the median time between frames
    max_rate_error : share of the stated rate by which the file's own times may contradict it
    max_bone_length_variation : share of a bone's length
    max_joint_speed, max_body_speed : m/s
    min_apart : metres; two people do not stand in each other
    """

    min_frames: int
    max_rate_jitter: float
    max_rate_error: float
    max_bone_length_variation: float
    max_joint_speed: float
    max_body_speed: float
    min_apart: float


def measure_quality(interaction: Interaction, *, contact_distance: float) -> Quality:
    """Measure a capture; joints within ``contact_distance`` metres of each other touch."""
    people = (interaction.person_a, interaction.person_b)
    steps = np.diff(interaction.times)
    speeds = np.stack([_speeds(motion, steps) for motion in people])
    least = min_joint_distance(interaction)
    same_joint = np.linalg.norm(people[0] - people[1], axis=-1)
    return Quality(
        n_frames=len(interaction.times),
        fps=interaction.fps,
        rate_jitter=float(np.abs(steps / np.median(steps) - 1).max()),
        bone_length_variation=max(_variation(m, interaction.skeleton) for m in people),
        max_joint_speed=float(speeds.max()),
        max_body_speed=float(np.median(speeds, axis=2).max()),
        min_joint_distance=float(least.min()),
        contact_share=float((least <= contact_distance).mean()),
        apart=float(same_joint.mean()),
    )


def limit_violations(
    quality: Quality, limits: QualityLimits, stated_fps: float | None = None
) -> list[str]:
    """Say in words where a capture passes its limits; nothing if it is good.

    Parameters
    ----------
    quality, limits : figures and their bounds
    stated_fps : the rate that the data set claims, where the times come from the file instead
    """
    tests = [
        (
            quality.n_frames < limits.min_frames,
            f"{quality.n_frames} frames, wanted at least {limits.min_frames}",
        ),
        (
            quality.rate_jitter > limits.max_rate_jitter,
            f"times between frames depart from their median by {quality.rate_jitter:.0%}, "
            f"wanted at most {limits.max_rate_jitter:.0%}",
        ),
        (
            quality.bone_length_variation > limits.max_bone_length_variation,
            f"bones change in length by {quality.bone_length_variation:.0%}, "
            f"wanted at most {limits.max_bone_length_variation:.0%}",
        ),
        (
            quality.max_joint_speed > limits.max_joint_speed,
            f"a joint jumps at {quality.max_joint_speed:.1f} m/s, "
            f"wanted at most {limits.max_joint_speed:.1f}",
        ),
        (
            quality.max_body_speed > limits.max_body_speed,
            f"a body jumps at {quality.max_body_speed:.1f} m/s, "
            f"wanted at most {limits.max_body_speed:.1f}",
        ),
        (
            quality.apart < limits.min_apart,
            f"the same body twice: joints {quality.apart:.3f} m from their like on average, "
            f"wanted at least {limits.min_apart:.3f}",
        ),
        (
            stated_fps is not None and abs(quality.fps / stated_fps - 1) > limits.max_rate_error,
            f"the file's own times give {quality.fps:.4g} frames a second, wanted {stated_fps}",
        ),
    ]
    return [words for is_fault, words in tests if is_fault]


def check_quality(quality: Quality, limits: QualityLimits, stated_fps: float | None = None) -> None:
    """Refuse a capture that has ``faults``.

    Raises
    ------
    QualityError
        With all of them in words.
    """
    found = limit_violations(quality, limits, stated_fps)
    if found:
        raise QualityError(found)


def _speeds(motion: Motion, steps: NDArray[np.float64]) -> NDArray[np.float64]:
    """``(T - 1, J)`` m/s."""
    paths: NDArray[np.float64] = np.linalg.norm(np.diff(motion, axis=0), axis=-1)
    return paths / steps[:, None]


def _variation(motion: Motion, skeleton: Skeleton) -> float:
    lengths = bone_lengths(motion, skeleton).astype(np.float64)
    mean = lengths.mean(axis=0)
    real = mean > _SHORTEST_BONE
    if not real.any():
        return float("inf")
    return float(np.median(lengths[:, real].std(axis=0) / mean[real]))
