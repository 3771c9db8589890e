"""Which bodies a source is given: the plan, and a name for each variation that says what it is.

Li et al. (2024), *Two-person interaction augmentation with skeleton priors*, supplement, section 1:
all bones of one body, or one bone of its upper body, scaled by 0.75 to 1.25 in steps of 0.05.
Unlike there, a plan may also name bodies of given anthropometry and draw bodies at random.
"""

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from fnmatch import fnmatchcase

import numpy as np

from pacmo_core.augmentation.bodies import (
    UNIFORM,
    Body,
    Population,
    Scales,
    profile_scales,
    sample_scales,
    segment_scales,
)

PEOPLE = ("a", "b")
UPPER_BODY = "upper"  # the bones above the hips, in place of a pattern


@dataclass(frozen=True, kw_only=True)
class SingleBones:
    """One bone longer or shorter than the others would have it.

    Parameters
    ----------
    bones : patterns of segments' names, or ``upper`` for all above the hips
    scales : of the bone; the source's own, 1, is left out
    max_variations : a source; which ones, a hash decides
    """

    bones: tuple[str, ...]
    scales: tuple[float, ...]
    max_variations: int


@dataclass(frozen=True, kw_only=True)
class Plan:
    """The bodies that every source is given.

    Parameters
    ----------
    people : whose body changes, one at a time: ``a``, ``b``
    uniform : scales of the whole body; the source's own, 1, is left out
    single : one bone at a time
    profiles : names of ``anthropometry.PROFILES``
    n_random : pairs of random bodies, of both people at once
    population : what they are drawn from

    Raises
    ------
    ValueError
        If a person or a scale is none.
    """

    people: tuple[str, ...]
    uniform: tuple[float, ...]
    single: SingleBones
    profiles: tuple[str, ...]
    n_random: int
    population: Population

    def __post_init__(self) -> None:
        if not set(self.people) <= set(PEOPLE):
            raise ValueError(f"people must be of {', '.join(PEOPLE)}; got {', '.join(self.people)}")
        for scale in (*self.uniform, *self.single.scales):
            check_scale("scales of a plan", scale)


@dataclass(frozen=True)
class Variation:
    """One pair of bodies.

    Parameters
    ----------
    name : unique in its plan, such as ``b-left_forearm-1.20``
    kind : ``uniform``, ``single``, ``profile`` or ``random``
    scales : two of (E,), of each bone of person a and of person b against the source's
    """

    name: str
    kind: str
    scales: tuple[Scales, Scales]

    @property
    def changes(self) -> bool:
        """Say whether any bone is other than the source's."""
        return any((scales != 1).any() for scales in self.scales)


def plan_variations(plan: Plan, bodies: tuple[Body, Body], source: str) -> list[Variation]:
    """List the variations of one source by name.

    Parameters
    ----------
    bodies : of person a and of person b
    source : its name; single bones are chosen for each source apart

    Raises
    ------
    ValueError
        If a pattern fits no segment, or a profile cannot be had.
    """
    found = [
        *_whole_body_variations(plan, bodies),
        *_single_bone_variations(plan, bodies, source),
        *_random_variations(plan, bodies),
    ]
    unlike = {variation.name: variation for variation in found if variation.changes}
    return [unlike[name] for name in sorted(unlike)]


def check_scale(what: str, scale: float) -> None:
    """Refuse a scale that no bone has.

    Raises
    ------
    ValueError
        If it is not a positive number.
    """
    if not (np.isfinite(scale) and scale > 0):
        raise ValueError(f"{what} must be positive numbers; got {scale}")


def _whole_body_variations(plan: Plan, bodies: tuple[Body, Body]) -> Iterator[Variation]:
    """Change all of one body: uniformly, or to a profile."""
    for person in plan.people:
        place = PEOPLE.index(person)
        for scale in plan.uniform:
            scales = _with_person(bodies, place, segment_scales(bodies[place], {UNIFORM: scale}))
            yield Variation(f"{person}-{UNIFORM}-{_format_scale(scale)}", "uniform", scales)
        for name in plan.profiles:
            scales = _with_person(bodies, place, profile_scales(bodies[place], name))
            yield Variation(f"{person}-{name}", "profile", scales)


def _single_bone_variations(plan: Plan, bodies: tuple[Body, Body], source: str) -> list[Variation]:
    """Change one bone of one body; of all that there are, those with the lowest hashes."""
    found = []
    for person in plan.people:
        place = PEOPLE.index(person)
        for bone in _matching_segments(bodies[place], plan.single.bones):
            for scale in plan.single.scales:
                scales = _with_person(bodies, place, segment_scales(bodies[place], {bone: scale}))
                found.append(Variation(f"{person}-{bone}-{_format_scale(scale)}", "single", scales))

    def rank(variation: Variation) -> bytes:
        text = f"{plan.population.random_seed}\0{source}\0{variation.name}"
        return hashlib.blake2b(text.encode(), digest_size=8).digest()

    return sorted((v for v in found if v.changes), key=rank)[: plan.single.max_variations]


def _random_variations(plan: Plan, bodies: tuple[Body, Body]) -> Iterator[Variation]:
    """Give both people bodies of the population."""
    for number in range(plan.n_random):
        name = f"r{number:04d}"
        a, b = (
            sample_scales(body, plan.population, f"{name}\0{person}")
            for body, person in zip(bodies, PEOPLE, strict=True)
        )
        yield Variation(name, "random", (a, b))


def _matching_segments(body: Body, patterns: tuple[str, ...]) -> list[str]:
    """List the segments that patterns fit, each once."""
    chosen: dict[str, None] = {}
    for pattern in patterns:
        fits = [
            s.name
            for s in body.segments
            if (s.is_upper if pattern == UPPER_BODY else fnmatchcase(s.name, pattern))
        ]
        if not fits:
            raise ValueError(f"no segment fits {pattern!r}; there are {UPPER_BODY}, {body.names}")
        chosen |= dict.fromkeys(fits)
    return list(chosen)


def _with_person(bodies: tuple[Body, Body], place: int, scales: Scales) -> tuple[Scales, Scales]:
    """Give one person a body, and leave the other as is."""
    both = [np.ones(len(body.segments)) for body in bodies]
    both[place] = scales
    return both[0], both[1]


def _format_scale(scale: float) -> str:
    """Write a scale so that no two are alike."""
    return f"{scale:.2f}" if float(f"{scale:.2f}") == scale else repr(scale)
