"""Scales of bones that turn a source's body into another one: grown, of a profile, or drawn."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pacmo_core.augmentation.anthropometry import PROFILES, SHIN, THIGH
from pacmo_core.augmentation.segments import Segment, segments
from pacmo_core.data.interaction import Motion, bone_lengths
from pacmo_core.data.skeleton import Skeleton

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
        return (means["thigh"] + means["shin"]) / (THIGH + SHIN)

    @property
    def names(self) -> str:
        """List the segments for a person to read."""
        return ", ".join(sorted(segment.name for segment in self.segments))


def body_of(motion: Motion, skeleton: Skeleton) -> Body:
    """Measure a person.

    Parameters
    ----------
    motion : (T, J, 3) metres
    """
    lengths = np.median(bone_lengths(motion, skeleton), axis=0).astype(np.float64)
    return Body(segments(skeleton), lengths)


def scaled(body: Body, factors: Mapping[str, float]) -> Scales:
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


def of_profile(body: Body, name: str) -> Scales:
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


def drawn(body: Body, population: Population, name: str) -> Scales:
    """``(E,)``: draw a body from the log-normal population.

    Each figure is drawn by its own name: the same body on another skeleton has the same stature
    and, where segments correspond, the same proportions.

    Parameters
    ----------
    name : of the body; another name, another body
    """
    spread = population.proportion
    logarithms = [
        population.stature * _normal(population, f"{name}\0stature")
        + spread * _normal(population, f"{name}\0segment\0{segment.kind}")
        for segment in body.segments
    ]
    scales: Scales = np.exp(np.array(logarithms))
    return scales


def _normal(population: Population, name: str) -> float:
    text = f"{population.random_seed}\0{name}".encode()
    seed = int.from_bytes(hashlib.blake2b(text, digest_size=8).digest())
    return float(np.random.default_rng(seed).standard_normal())
