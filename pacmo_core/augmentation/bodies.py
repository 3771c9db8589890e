"""What is known of human bodies: how long segments are, how tall people are, how they differ.

Segments as shares of stature: Drillis and Contini (1966), *Body segment parameters*, as Winter
(2009), *Biomechanics and motor control of human movement*, figure 4.1, draws them.

Adults: Gordon et al. (2014), *2012 anthropometric survey of U.S. Army personnel* (ANSUR II), which
measured 4,082 men and 1,986 women.

Children: de Onis et al. (2007), *Development of a WHO growth reference for school-aged children and
adolescents*; and, for how long their legs are, the sitting height over stature of Fredriks et al.
(2005), *Nationwide age references for sitting height, leg length, and sitting height/height ratio*
(the fourth Dutch growth study), read off its charts, so to about 0.005.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pacmo_core.augmentation.segments import Segment, segments
from pacmo_core.data.interaction import Motion, bone_lengths
from pacmo_core.data.skeleton import Skeleton

# Drillis and Contini: shares of stature.
THIGH_RATIO, SHIN_RATIO = 0.245, 0.246

# ANSUR II: metres, mean and standard deviation of men's stature.
MEN_STATURE, MEN_STATURE_SD = 1.756, 0.069
# ANSUR II: a standard deviation as a share of the mean, men's upper arms (acromion to radiale).
ARM_LENGTH_CV = 0.05

# WHO 2007: metres, boys of eight years, median; girls' is 7 mm less.
CHILD_STATURE = 1.273
# Fredriks et al.: sitting height over stature.
CHILD_SITTING_RATIO, ADULT_SITTING_RATIO = 0.54, 0.52


@dataclass(frozen=True)
class Profile:
    """A body to be had.

    Parameters
    ----------
    stature : metres; None for the source's own
    parts : by which factor parts of the body are longer than stature alone would make them;
        parts that are not named follow stature
    """

    stature: float | None
    parts: dict[str, float]


PROFILES = {
    # Legs are shorter, trunk and head longer, for the same stature.
    "child": Profile(
        CHILD_STATURE,
        {
            "leg": (1 - CHILD_SITTING_RATIO) / (1 - ADULT_SITTING_RATIO),
            "trunk": CHILD_SITTING_RATIO / ADULT_SITTING_RATIO,
        },
    ),
    # Taller than 97 or 98 men of a hundred.
    "tall_adult": Profile(MEN_STATURE + 2 * MEN_STATURE_SD, {}),
    # Arms longer than those of 97 or 98 of a hundred bodies of that stature.
    "long_arms": Profile(None, {"arm": 1 + 2 * ARM_LENGTH_CV}),
}


# FROM """Scales of bones that turn a source's body into another one: grown, of a profile, or drawn."""
Scales = NDArray[np.float64]
UNIFORM = "uniform"


@dataclass(frozen=True)
class Body:
    """One person of a source, as far as scales go.

    Parameters
    ----------
    segments : of each bone, in the order of ``skeleton.bones``
    lengths : (E,) metres, medians over time
    """

    segments: tuple[Segment, ...]
    lengths: NDArray[np.float64]

    @property
    def stature(self) -> float:
        """Metres: how tall a person with these legs is, by Drillis and Contini.

        Raises
        ------
        ValueError
            If the body has no thighs or no shins.
        """
        means = {}
        for kind in ("thigh", "shin"):
            own = [s.kind == kind for s in self.segments]
            if not any(own):
                raise ValueError(f"no {kind} to tell a stature by; segments: {self.names}")
            means[kind] = float(self.lengths[own].mean())
        return (means["thigh"] + means["shin"]) / (THIGH_RATIO + SHIN_RATIO)

    @property
    def names(self) -> str:
        """List the segments for a person to read."""
        return ", ".join(sorted(segment.name for segment in self.segments))


def measure_body(motion: Motion, skeleton: Skeleton) -> Body:
    """Measure a person.

    Parameters
    ----------
    motion : (T, J, 3) metres
    """
    lengths = np.median(bone_lengths(motion, skeleton), axis=0).astype(np.float64)
    return Body(segments(skeleton), lengths)


def segment_scales(body: Body, factors: Mapping[str, float]) -> Scales:
    """``(E,)``: scale segments by name; ``uniform`` means all of them, times their own.

    Raises
    ------
    ValueError
        If there is no such segment.
    """
    known = {segment.name for segment in body.segments}
    unknown = sorted(set(factors) - known - {UNIFORM})
    if unknown:
        raise ValueError(f"no segment {', '.join(unknown)}; there are {UNIFORM}, {body.names}")
    whole = factors.get(UNIFORM, 1.0)
    return np.array([whole * factors.get(segment.name, 1.0) for segment in body.segments])


def profile_scales(body: Body, name: str) -> Scales:
    """``(E,)``: give a source's body the stature and proportions of a profile.

    Raises
    ------
    ValueError
        If there is no such profile, or the body has no legs to tell its stature by.
    """
    if name not in PROFILES:
        raise ValueError(f"no profile {name!r}; there are {', '.join(PROFILES)}")
    profile = PROFILES[name]
    whole = 1.0 if profile.stature is None else profile.stature / body.stature
    return np.array([whole * profile.parts.get(segment.part, 1.0) for segment in body.segments])


@dataclass(frozen=True, kw_only=True)
class Population:
    """How drawn bodies differ from their source, in logarithms of length.

    Parameters
    ----------
    stature : standard deviation, of all bones together
    proportion : standard deviation, of each kind of segment for itself; left and right are alike
    random_seed : another seed, other bodies
    """

    stature: float
    proportion: float
    random_seed: int


def sample_scales(body: Body, population: Population, name: str) -> Scales:
    """``(E,)``: draw a body from the log-normal population.

    Each figure is drawn by its own name: the same body on another skeleton has the same stature
    and, where segments correspond, the same proportions.

    Parameters
    ----------
    name : of the body; another name, another body
    """
    spread = population.proportion
    logarithms = [
        population.stature * _standard_normal(population, f"{name}\0stature")
        + spread * _standard_normal(population, f"{name}\0segment\0{segment.kind}")
        for segment in body.segments
    ]
    scales: Scales = np.exp(np.array(logarithms))
    return scales


def _standard_normal(population: Population, name: str) -> float:
    text = f"{population.random_seed}\0{name}".encode()
    seed = int.from_bytes(hashlib.blake2b(text, digest_size=8).digest())
    return float(np.random.default_rng(seed).standard_normal())
