"""Stature and upward axis of a person, whatever the unit and the axes of the motion.

Both are measured on body segments (``data.segments``), which every skeleton with arms and legs has:
the stature on the legs, so that it does not depend on the posture; the upward axis on the trunk of
the most upright frames, and on the floor, which the lowest joint does not leave for long.

Segment lengths as fractions of stature: Drillis and Contini (1966), *Body segment parameters*, as
in Winter (2009), *Biomechanics and motor control of human movement*, figure 4.1.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.segments import segments
from pacmo_core.data.skeleton import Skeleton

THIGH_RATIO, SHIN_RATIO = 0.245, 0.246  # of the stature

MIN_STATURE, MAX_STATURE = 0.5, 2.6  # metres, of any person, with a margin
# Metres: from a child of two to a very tall adult. The units are further apart than these.
_USUAL_STATURES = (0.9, 2.2)
_TYPICAL_STATURE = 1.7
# Units that capture programs write, in metres; 1/0.45 inch is that of CMU's files.
UNITS = {"metres": 1.0, "centimetres": 0.01, "millimetres": 0.001, "inches": 0.0254}
UNIT_WORDS = {
    "m": 1.0,
    "cm": 0.01,
    "mm": 0.001,
    "in": 0.0254,
    **UNITS,
    # As they are spelled in America, and of one.
    "meters": 1.0,
    "centimeters": 0.01,
    "millimeters": 0.001,
    "inch": 0.0254,
}
CMU_UNIT = 0.0254 / 0.45

_LEGS = ("left_thigh", "left_shin", "right_thigh", "right_shin")
_ARMS = ("left_upper_arm", "right_upper_arm")
_UPRIGHT_SHARE = 0.25  # of the frames: those in which the trunk is most upright
_UPRIGHT, _NOT_UPRIGHT = 0.8, 0.5  # cosine of the angle between trunk and axis
_UPRIGHT_ALWAYS = 0.9  # share of the frames
_STEADY = 3.0  # times as far as the floor does the lowest joint move along another axis
_UNSTEADY = 0.03  # statures: less is noise
_LEVEL = 0.1  # statures, by which the floor may differ under two people
_STEADY_FEET = 1.5  # times as far as the feet do the hands or the head of a standing person move


@dataclass(frozen=True)
class Posture:
    """What is known of a person before unit and axes are.

    Parameters
    ----------
    stature : in units of the motion
    trunk : (T, 3) float64, unit vectors from the hips to the shoulders
    lowest, highest : (T, 3) float64, the smallest and the largest coordinate of a joint in a frame,
        in statures
    """

    stature: float
    trunk: NDArray[np.float64]
    lowest: NDArray[np.float64]
    highest: NDArray[np.float64]


def measure_posture(motion: NDArray[np.floating], skeleton: Skeleton) -> Posture | None:
    """Measure a person; None for a skeleton without two arms and two legs, or without extent.

    Parameters
    ----------
    motion : (T, J, 3) in any unit and axes
    """
    if missing_limbs(skeleton) or not len(motion):
        return None
    rows = {segment.name: row for row, segment in enumerate(segments(skeleton))}
    bones = skeleton.bones
    lengths = [_median_length(motion, bones[rows[name]]) for name in _LEGS]
    hips, shoulders = (
        np.mean([motion[:, bones[rows[name], 0]] for name in starts], axis=0)
        for starts in (_LEGS[::2], _ARMS)
    )
    trunk = (shoulders - hips).astype(np.float64)
    norms = np.linalg.norm(trunk, axis=-1, keepdims=True)
    stature = sum(lengths) / 2 / (THIGH_RATIO + SHIN_RATIO)
    if not stature > 0 or not (norms > 0).all():
        return None
    lowest, highest = (extreme(axis=1) / stature for extreme in (motion.min, motion.max))
    return Posture(stature, trunk / norms, lowest, highest)


def upward_axis(motion: NDArray[np.floating], skeleton: Skeleton) -> int:
    """Return the axis, 0, 1 or 2, along which a trunk is on average; without one, a body's extent.

    Parameters
    ----------
    motion : (T, J, 3) in any unit and axes
    """
    posture = measure_posture(motion, skeleton)
    along = np.ptp(motion, axis=1) if posture is None else posture.trunk
    return int(np.abs(along.mean(axis=0)).argmax())


def missing_limbs(skeleton: Skeleton) -> list[str]:
    """Return the limbs that a posture is measured on and a skeleton does not have."""
    present = {segment.name for segment in segments(skeleton)}
    return [name for name in (*_LEGS, *_ARMS) if name not in present]


def _median_length(motion: NDArray[np.floating], bone: NDArray[np.intp]) -> float:
    parent, child = bone
    return float(np.median(np.linalg.norm(motion[:, child] - motion[:, parent], axis=-1)))


def infer_unit(posture: Posture, *, of_cmu: bool = False) -> float | None:
    """Return the metres a unit with which the person has a usual stature, or is nearest to one.

    Parameters
    ----------
    posture : of a person
    of_cmu : whether the joints have CMU's names, whose files are often in CMU's unit

    Returns
    -------
    None if the person is impossibly small or large in every unit.
    """
    candidates = [*UNITS.values(), *([CMU_UNIT] if of_cmu else [])]

    def distance(unit: float) -> tuple[float, float]:
        stature = unit * posture.stature
        usual = min(max(stature, _USUAL_STATURES[0]), _USUAL_STATURES[1])
        return abs(math.log(stature / usual)), abs(math.log(stature / _TYPICAL_STATURE))

    best = min(candidates, key=distance)
    return best if MIN_STATURE <= best * posture.stature <= MAX_STATURE else None


def infer_up(posture: Posture) -> str | None:
    """Return the upward axis, ``y`` or ``z``; None if the motion does not show it.

    A person on the floor has the trunk along another axis for most of a clip: the most upright
    frames count, and where they do not decide, along which axis the lowest joint stays at a height.
    """
    upright = {axis: _upright(posture.trunk[:, column]) for axis, column in (("y", 1), ("z", 2))}
    standing = [axis for axis, cosine in upright.items() if cosine >= _UPRIGHT]
    if len(standing) == 1:
        return standing[0]
    moved = {"y": float(posture.lowest[:, 1].std()), "z": float(posture.lowest[:, 2].std())}
    steady, other = sorted(moved, key=lambda axis: moved[axis])
    is_floor = moved[other] > max(_UNSTEADY, _STEADY * moved[steady])
    return steady if is_floor and upright[steady] > 0 else None


def lying_fault(posture: Posture) -> str:
    """Say what is wrong with a person who stands along another axis than y; empty if it is unclear.

    Clear is a person who is never upright along y and nearly always along another axis, and whose
    lowest joint keeps its height along that axis: on the floor, or in a handstand, it would keep it
    along y.

    Parameters
    ----------
    posture : of a motion that is meant to have y up
    """
    if _upright(posture.trunk[:, 1]) >= _NOT_UPRIGHT:
        return ""
    moved = float(posture.lowest[:, 1].std())
    if _stands_along(-posture.trunk[:, 1]):
        feet = float(posture.highest[:, 1].std())
        return "upside down" if moved > _STEADY_FEET * feet else ""
    for column in (0, 2):
        for sign, lowest in ((1, posture.lowest), (-1, posture.highest)):
            steady = float(lowest[:, column].std())
            is_floor = moved > max(_UNSTEADY, _STEADY * steady)
            if _stands_along(sign * posture.trunk[:, column]) and is_floor:
                return "lying while standing"
    return ""


def stand_along_another_axis(postures: Sequence[Posture]) -> bool:
    """Whether all people stand along one other axis than y, with their feet at one place along it.

    People who lie beside each other seldom do so throughout, side by side to a few centimetres; who
    stands on a floor, of which another axis than y is up, does.

    Parameters
    ----------
    postures : of two people or more, of motions that are meant to have y up
    """
    for column in (0, 2):
        for sign, feet in ((1, "lowest"), (-1, "highest")):
            levels = [float(np.median(getattr(one, feet)[:, column])) for one in postures]
            stature = min(one.stature for one in postures)
            if np.ptp(levels) < _LEVEL * stature and all(
                _stands_along(sign * one.trunk[:, column]) for one in postures
            ):
                return True
    return False


def _stands_along(cosines: NDArray[np.float64]) -> bool:
    return bool((cosines >= _UPRIGHT).mean() >= _UPRIGHT_ALWAYS)


def _upright(cosines: NDArray[np.float64]) -> float:
    """Return the mean cosine of the most upright frames."""
    count = max(1, int(_UPRIGHT_SHARE * len(cosines)))
    return float(np.sort(cosines)[-count:].mean())
