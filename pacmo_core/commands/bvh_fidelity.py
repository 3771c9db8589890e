"""BVH files of two people: which joints must be met best, and how well the files hold the motions.

Bones of a BVH file are rigid, so not every pose can be held. What cannot is left to joints that
nobody looks at: feet that stand, joints near the ground and joints near the other person come
first.
"""

from collections.abc import Sequence
from dataclasses import astuple, dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from pacmo_core.data.interaction import Motion
from pacmo_core.data.segments import feet
from pacmo_core.figures.numbers import format_fixed
from pacmo_core.formats.inverse_kinematics import (
    CONTACT_DISTANCE,
    contact_targets,
    proximity_weights,
)
from pacmo_core.formats.registry import PersonMotion
from pacmo_core.reaction.stance import find_stance

# Weight of the squared error of the joints of a foot that stands, in addition to that of any joint,
# 1. It fades in and out, as a step in a weight would cause a jerk.
PLANTED_WEIGHT = 100.0
PLANTED_FADE = 0.05  # seconds, standard deviation
RESOLUTION = 5e-5  # metres: the largest error that is printed as nothing


def planted_weights(person: PersonMotion) -> NDArray[np.float64]:
    """``(T, J)``: the weight that joints of feet have where they stand, 0 for all others."""
    weights = np.zeros(person.motion.shape[:2])
    fps = frame_rate(person)
    stance = find_stance(person.motion, fps, person.skeleton)
    for foot, stands in zip(feet(person.skeleton), stance, strict=True):
        faded = gaussian_filter1d(stands.astype(np.float64), PLANTED_FADE * fps, mode="nearest")
        weights[:, list(foot)] = PLANTED_WEIGHT * faded[:, None]
    return weights


def frame_rate(person: PersonMotion) -> float:
    """Frames per second."""
    return float(1 / np.median(np.diff(person.times)))


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


@dataclass(frozen=True)
class Fidelity:
    """How well files hold the motions that were written, measured on what is read back.

    Parameters
    ----------
    max_error : metres, the largest distance of a joint from where it was to be
    n_joints, summed_error : of all joints in all frames; metres
    contacts, contacts_held : number of pairs of joints of the two people in contact, over all
        frames, and of those that are in contact in the files
    n_planted, slide, slide_in_file : of ankles of feet that stand in two frames in a row: their
        number and their summed horizontal speeds, metres per second
    """

    max_error: float = 0.0
    n_joints: int = 0
    summed_error: float = 0.0
    contacts: int = 0
    contacts_held: int = 0
    n_planted: int = 0
    slide: float = 0.0
    slide_in_file: float = 0.0

    @classmethod
    def of(cls, wanted: Sequence[PersonMotion], found: Sequence[PersonMotion]) -> "Fidelity":
        """Compare the motions of person a and person b, or of one, with those of the files."""
        pairs = list(zip(wanted, found, strict=True))
        errors = [np.linalg.norm(back.motion - person.motion, axis=-1) for person, back in pairs]
        touch, in_file = _contacts(wanted), _contacts(found)
        slides = [_slides(person, (person.motion, back.motion)) for person, back in pairs]
        slide, slide_in_file = np.concatenate(slides, axis=1)
        return cls(
            float(max(error.max() for error in errors)),
            sum(error.size for error in errors),
            float(sum(error.sum() for error in errors)),
            int(touch.sum()),
            int((touch & in_file).sum()),
            len(slide),
            float(slide.sum()),
            float(slide_in_file.sum()),
        )

    def __add__(self, other: "Fidelity") -> "Fidelity":
        """Return that of both together."""
        max_error = max(self.max_error, other.max_error)
        sums = (a + b for a, b in zip(astuple(self)[1:], astuple(other)[1:], strict=True))
        return Fidelity(max_error, *sums)

    @property
    def is_inexact(self) -> bool:
        """Whether a joint is off by what would be printed as more than nothing."""
        return self.max_error > RESOLUTION

    def error_line(self) -> str:
        """Say how far joints in the files are from where they were to be."""
        mean = 1e3 * self.summed_error / max(self.n_joints, 1)
        return (
            "in the files, against the exact motion: bones of this format cannot stretch, so "
            f"joints are off by {mean:.1f} mm on average, {1e3 * self.max_error:.1f} mm at most"
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
            parts.append(
                f"{share:.1f} % of the {self.contacts} touches (two joints within 10 cm in a "
                "frame) are kept"
            )
        else:
            parts.append("there are no touches (two joints within 10 cm in a frame)")
        return "; ".join(parts)


def _slides(person: PersonMotion, motions: tuple[Motion, Motion]) -> NDArray[np.float64]:
    """``(2, N)`` metres per second: of ankles that stand, in both motions of one person."""
    stance = find_stance(person.motion, frame_rate(person), person.skeleton)
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
