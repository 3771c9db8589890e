"""BVH files of two people: which joints must be met best, and how well the files hold the motions.

Bones of a BVH file are rigid, so not every pose can be held. What cannot is left to joints that
nobody looks at: feet that stand, joints near the ground and joints near the other person come
first.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from pacmo_core.commands.peaks import when
from pacmo_core.data.interaction import Motion
from pacmo_core.data.segments import feet
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.figures.numbers import format_fixed
from pacmo_core.finish.stance import find_stance
from pacmo_core.formats.base import to_y_up
from pacmo_core.formats.bvh import read_bvh
from pacmo_core.formats.bvh_pairs import BvhPairs
from pacmo_core.formats.inverse_kinematics import (
    CONTACT_DISTANCE,
    contact_targets,
    proximity_weights,
)
from pacmo_core.formats.registry import DEFAULT_SETTINGS, PersonMotion
from pacmo_core.formats.resample import frame_rate

# Weight of the squared error of the joints of a foot that stands, in addition to that of any joint,
# 1. It fades in and out, as a step in a weight would cause a jerk.
PLANTED_WEIGHT = 100.0
PLANTED_FADE = 0.05  # seconds, standard deviation
MIN_END_SITE = 1e-3  # metres: a shorter one lies on its joint
RESOLUTION = 5e-5  # metres: the largest error that is printed as nothing
# Metres: where a pelvis is off by 10 cm it was seen to tilt by 32 degrees, in captures by 13.
MAX_ERROR = 0.08
BEYOND = (
    "look at that frame, where the body bends or tilts as its bones cannot follow, before you use "
    "that file"
)


def planted_weights(person: PersonMotion) -> NDArray[np.float64]:
    """``(T, J)``: the weight that joints of feet have where they stand, 0 for all others."""
    weights = np.zeros(person.motion.shape[:2])
    fps = frame_rate(person.times)
    stance = find_stance(person.motion, fps, person.skeleton)
    for foot, stands in zip(feet(person.skeleton), stance, strict=True):
        faded = gaussian_filter1d(stands.astype(np.float64), PLANTED_FADE * fps, mode="nearest")
        weights[:, list(foot)] = PLANTED_WEIGHT * faded[:, None]
    return weights


def pair_targets(a: PersonMotion, b: PersonMotion) -> list[tuple[Motion, NDArray[np.float64]]]:
    """Return what constant bones shall meet of two people: for each the aims and their weights.

    Returns
    -------
    (T, J, 3) metres and (T, J), of person a and of person b
    """
    aims = contact_targets(a.motion, b.motion)
    near = proximity_weights(a.motion, b.motion)
    return [
        (aim, weights + planted_weights(person))
        for person, aim, weights in zip((a, b), aims, near, strict=True)
    ]


def with_end_sites(file: Path, person: PersonMotion, settings: Mapping[str, Any]) -> PersonMotion:
    """Add the End Sites of a BVH file to a person who was read from it.

    They are what one sees: toes and fingertips. Those that lie on their joint are left out.
    """
    bvh = read_bvh(file)
    pairs = BvhPairs(**{**DEFAULT_SETTINGS["bvh"], **settings})
    unit, body = pairs.metres(file), person.skeleton
    lengths = np.linalg.norm(bvh.offsets, axis=-1) * unit
    ends = [end for end in bvh.end_sites if lengths[end] >= MIN_END_SITE]
    places = to_y_up(bvh.positions()[pairs.skip_frames :, ends] * unit, pairs.up_axis)
    joints = (*body.joints, *(bvh.joints[end] for end in ends))
    parents = (*body.parents, *(joints.index(bvh.joints[bvh.parents[end]]) for end in ends))
    return PersonMotion(
        Skeleton(body.name, joints, parents, body.left_right),
        person.times,
        np.concatenate([person.motion, places.astype(np.float32)], axis=1),
    )


@dataclass(frozen=True)
class Extreme:
    """The largest of some distances in metres, and where it is."""

    value: float = 0.0
    place: str = ""


@dataclass(frozen=True)
class Fidelity:
    """How well files hold the motions that were written, measured on what is read back.

    Parameters
    ----------
    max_error : the largest distance of a joint from where it was to be
    missed : of pairs of joints that are in contact in the motions and not in the files, the largest
        distance in the files
    n_joints, summed_error : of all joints in all frames, of people whose file is not exact; metres
    contacts, contacts_held : number of pairs of joints of the two people in contact, over all
        frames, and of those that are in contact in the files
    n_planted, slide, slide_in_file : of ankles, of the same people, of feet that stand in two
        frames in a row: their number and their summed horizontal speeds, metres per second
    """

    max_error: Extreme = Extreme()
    missed: Extreme = Extreme()
    n_joints: int = 0
    summed_error: float = 0.0
    contacts: int = 0
    contacts_held: int = 0
    n_planted: int = 0
    slide: float = 0.0
    slide_in_file: float = 0.0

    @classmethod
    def of(
        cls,
        wanted: Sequence[PersonMotion],
        found: Sequence[PersonMotion],
        names: Sequence[object],
        sample: str = "",
    ) -> "Fidelity":
        """Compare the motions of person a and person b, or of one, with those of the files.

        Parameters
        ----------
        names : of what holds each person, such as files
        sample : its name, where there are several
        """
        pairs = list(zip(wanted, found, strict=True))
        errors = [np.linalg.norm(back.motion - person.motion, axis=-1) for person, back in pairs]
        touch, in_file = _contacts(wanted), _contacts(found)
        # A partner who is written as captured would halve what became of the other.
        changed = [n for n, error in enumerate(errors) if error.max() > RESOLUTION]
        fitted = [pairs[n] for n in changed] or pairs
        slides = [_slides(person, (person.motion, back.motion)) for person, back in fitted]
        slide, slide_in_file = np.concatenate(slides, axis=1)
        largest = [
            _largest_error(person, error, name)
            for person, error, name in zip(wanted, errors, names, strict=True)
        ]
        return cls(
            max(largest, key=lambda extreme: extreme.value),
            _farthest_missed(found, touch & ~in_file, sample),
            sum(person.motion[..., 0].size for person, _ in fitted),
            float(sum(errors[n].sum() for n in changed)),
            int(touch.sum()),
            int((touch & in_file).sum()),
            len(slide),
            float(slide.sum()),
            float(slide_in_file.sum()),
        )

    def __add__(self, other: "Fidelity") -> "Fidelity":
        """Return that of both together."""
        max_error = max(self.max_error, other.max_error, key=lambda extreme: extreme.value)
        missed = max(self.missed, other.missed, key=lambda extreme: extreme.value)
        mine, others = ([getattr(one, f.name) for f in fields(one)[2:]] for one in (self, other))
        return Fidelity(max_error, missed, *(a + b for a, b in zip(mine, others, strict=True)))

    @property
    def is_of_files(self) -> bool:
        """Whether anything was compared: files of constant bones were written."""
        return self.n_joints > 0

    @property
    def is_inexact(self) -> bool:
        """Whether a joint is off by what would be printed as more than nothing."""
        return self.max_error.value > RESOLUTION

    @property
    def is_seen(self) -> bool:
        """Whether a joint is off by so much that the pose looks different."""
        return self.max_error.value > MAX_ERROR

    def error_line(self) -> str:
        """Say how far joints in the files are from where they were to be."""
        if not self.is_inexact:
            return "in the files, against the exact motion: no joint is off by 0.1 mm"
        mean = 1e3 * self.summed_error / max(self.n_joints, 1)
        return (
            "in the files, against the exact motion: bones of this format cannot stretch, so "
            f"joints are off by {mean:.1f} mm on average, {1e3 * self.max_error.value:.1f} mm at "
            f"most ({self.max_error.place})"
            + (f", over {1e3 * MAX_ERROR:.0f} mm: {BEYOND}" if self.is_seen else "")
        )

    def line(self) -> str:
        """Say ``error_line``, and what became of feet and touches."""
        parts = [self.error_line()]
        if self.n_planted:
            added = 100 * (self.slide_in_file - self.slide) / self.n_planted
            speed = format_fixed(added, 2)
            more = "less" if speed.startswith("−") else "more"
            parts.append(f"standing feet slide {speed.lstrip('−')} cm/s {more}")
        if self.contacts:
            share = 100 * self.contacts_held / self.contacts
            missed = (
                f", the farthest missed {self.missed.place}: {1e2 * self.missed.value:.1f} cm"
                if self.contacts_held < self.contacts
                else ""
            )
            parts.append(
                f"{share:.1f} % of the exact motion's {self.contacts:,} touches (two joints within "
                f"10 cm in a frame) are kept{missed}"
            )
        else:
            parts.append("the two touch nowhere (no two joints within 10 cm in a frame)")
        return "; ".join(parts)


def _largest_error(person: PersonMotion, errors: NDArray[np.float64], name: object) -> Extreme:
    """Find the joint that is farthest from where it was to be, of errors (T, J) in metres."""
    frame, joint = (int(i) for i in np.unravel_index(errors.argmax(), errors.shape))
    place = f"{person.skeleton.joints[joint]} {_when(person, frame)} of {name}"
    return Extreme(float(errors[frame, joint]), place)


def _farthest_missed(
    found: Sequence[PersonMotion], missed: NDArray[np.bool_], sample: str
) -> Extreme:
    """Find the touch that is farthest apart in the files, of those missed (J_a, T, J_b)."""
    if not missed.any():
        return Extreme()
    a, b = found
    first, frames, second = np.nonzero(missed)
    distances = np.linalg.norm(a.motion[frames, first] - b.motion[frames, second], axis=-1)
    most = int(distances.argmax())
    names = a.skeleton.joints[first[most]], b.skeleton.joints[second[most]]
    of_sample = f" of {sample}" if sample else ""
    place = f"{names[0]} of person a and {names[1]} of b {_when(a, int(frames[most]))}{of_sample}"
    return Extreme(float(distances[most]), place)


def _when(person: PersonMotion, frame: int) -> str:
    return when(frame, person.times[frame] - person.times[0])


def _slides(person: PersonMotion, motions: tuple[Motion, Motion]) -> NDArray[np.float64]:
    """``(2, N)`` metres per second: of ankles that stand, in both motions of one person."""
    stance = find_stance(person.motion, frame_rate(person.times), person.skeleton)
    steps = np.diff(person.times)
    found = [np.zeros((2, 0))]
    for foot, stands in zip(feet(person.skeleton), stance, strict=True):
        paths = np.stack([motion[:, foot[0]][:, [0, 2]] for motion in motions])
        speeds = np.linalg.norm(np.diff(paths, axis=1), axis=-1) / steps
        found.append(speeds[:, stands[1:] & stands[:-1]])
    return np.concatenate(found, axis=1)


def _contacts(people: Sequence[PersonMotion]) -> NDArray[np.bool_]:
    """``(J_a, T, J_b)``: whether joints of two people are in contact; (0,) of one person."""
    if len(people) < 2:
        return np.zeros(0, np.bool_)
    a, b = (person.motion for person in people)
    return np.stack(  # one joint at a time
        [np.linalg.norm(b - joint[:, None], axis=-1) < CONTACT_DISTANCE
         for joint in np.moveaxis(a, 1, 0)]
    )  # fmt: skip
