"""Skeleton scales (bone scales) from a source's body to another: by segment, profile, or random.

Adults: Gordon et al. (2014), *2012 anthropometric survey of U.S. Army personnel* (ANSUR II), 4,082
men and 1,986 women.

Children: de Onis et al. (2007), *Development of a WHO growth reference for school-aged children and
adolescents*. Their leg length: the sitting height over stature of Fredriks et al. (2005),
*Nationwide age references for sitting height, leg length, and sitting height/height ratio* (fourth
Dutch growth study), read off its charts to about 0.005.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.interaction import Motion, bone_lengths
from pacmo_core.data.posture import SHIN_RATIO, THIGH_RATIO
from pacmo_core.data.segments import Segment, segments
from pacmo_core.data.skeleton import Skeleton

Scales = NDArray[np.float64]
UNIFORM = "uniform"

# ANSUR II: metres, mean and standard deviation of men's stature.
MEN_STATURE, MEN_STATURE_SD = 1.756, 0.069
# ANSUR II: coefficient of variation of men's upper arms (acromion to radiale).
ARM_LENGTH_CV = 0.05

# WHO 2007: metres, median of boys of eight years; girls' is 7 mm less.
CHILD_STATURE = 1.273
# Fredriks et al.: sitting height over stature.
CHILD_SITTING_RATIO, ADULT_SITTING_RATIO = 0.54, 0.52


@dataclass(frozen=True)
class Profile:
    """Stature and proportions of a target body.

    Parameters
    ----------
    stature : metres; None for the source's
    part_factors : length of parts of the body relative to a body of that stature; 1 for parts that
        are not named
    """

    stature: float | None
    part_factors: dict[str, float]


PROFILES = {
    # Shorter legs, longer trunk and head than an adult of the same stature.
    "child": Profile(
        CHILD_STATURE,
        {
            "leg": (1 - CHILD_SITTING_RATIO) / (1 - ADULT_SITTING_RATIO),
            "trunk": CHILD_SITTING_RATIO / ADULT_SITTING_RATIO,
        },
    ),
    # Two standard deviations above the mean: taller than 97 to 98 % of men.
    "tall_adult": Profile(MEN_STATURE + 2 * MEN_STATURE_SD, {}),
    # Two standard deviations above the mean for the stature.
    "long_arms": Profile(None, {"arm": 1 + 2 * ARM_LENGTH_CV}),
}


@dataclass(frozen=True)
class BodyBones:
    """The bones of one person.

    Parameters
    ----------
    segments : of each bone, in the order of ``skeleton.bones``
    lengths : (E,) metres, medians over time
    """

    segments: tuple[Segment, ...]
    lengths: NDArray[np.float64]

    @property
    def stature(self) -> float:
        """Metres: stature of a person with this leg length, after Drillis and Contini.

        Raises
        ------
        ValueError
            If the body has no thighs or no shins.
        """
        means = {}
        for kind in ("thigh", "shin"):
            is_kind = [s.kind == kind for s in self.segments]
            if not any(is_kind):
                raise ValueError(f"no {kind} to estimate the stature from; segments: {self.names}")
            means[kind] = float(self.lengths[is_kind].mean())
        return (means["thigh"] + means["shin"]) / (THIGH_RATIO + SHIN_RATIO)

    @property
    def names(self) -> str:
        """The names of the segments, sorted, for messages."""
        return ", ".join(sorted(segment.name for segment in self.segments))


def measure_body(motion: Motion, skeleton: Skeleton) -> BodyBones:
    """Measure the bone lengths of a person.

    Parameters
    ----------
    motion : (T, J, 3) metres
    """
    lengths = np.median(bone_lengths(motion, skeleton), axis=0).astype(np.float64)
    return BodyBones(segments(skeleton), lengths)


def segment_scales(body: BodyBones, factors: Mapping[str, float]) -> Scales:
    """Return the bone scales ``(E,)`` for factors of segments; ``uniform`` multiplies all of them.

    Raises
    ------
    ValueError
        If there is no such segment.
    """
    names = {segment.name for segment in body.segments}
    unknown = sorted(set(factors) - names - {UNIFORM})
    if unknown:
        raise ValueError(f"no segment {', '.join(unknown)}; there are {UNIFORM}, {body.names}")
    uniform = factors.get(UNIFORM, 1.0)
    return np.array([uniform * factors.get(segment.name, 1.0) for segment in body.segments])


def profile_scales(body: BodyBones, name: str) -> Scales:
    """Return the bone scales ``(E,)`` to the stature and proportions of a profile.

    Raises
    ------
    ValueError
        If there is no such profile, or the body has no legs from which to estimate its stature.
    """
    if name not in PROFILES:
        raise ValueError(f"no profile {name!r}; there are {', '.join(PROFILES)}")
    profile = PROFILES[name]
    uniform = 1.0 if profile.stature is None else profile.stature / body.stature
    factors = profile.part_factors
    return np.array([uniform * factors.get(segment.part, 1.0) for segment in body.segments])


@dataclass(frozen=True, kw_only=True)
class Population:
    """Log-normal distribution of bone scales.

    Parameters
    ----------
    stature : standard deviation of the logarithm of the scale of all bones
    proportion : standard deviation of the logarithm of the scale of each kind of segment; left and
        right have the same
    random_seed : int
    """

    stature: float
    proportion: float
    random_seed: int


def sample_scales(body: BodyBones, population: Population, name: str) -> Scales:
    """Sample a random body: bone scales ``(E,)`` from a log-normal population.

    The same name gives the same stature on any skeleton and, for corresponding segments, the same
    proportions.

    Parameters
    ----------
    name : of the sample
    """
    # The seeds are hashes of these strings; another string would be another body.
    logarithms = [
        population.stature * _standard_normal(population, f"{name}\0stature")
        + population.proportion * _standard_normal(population, f"{name}\0segment\0{segment.kind}")
        for segment in body.segments
    ]
    scales: Scales = np.exp(np.array(logarithms))
    return scales


def _standard_normal(population: Population, name: str) -> float:
    text = f"{population.random_seed}\0{name}".encode()
    seed = int.from_bytes(hashlib.blake2b(text, digest_size=8).digest())
    return float(np.random.default_rng(seed).standard_normal())
