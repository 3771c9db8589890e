"""The target bodies of each source, with a name for each variation.

Li et al. (2024), *Two-person interaction augmentation with skeleton priors*, supplement, section 1:
all bones of one body, or one bone of its upper body, scaled by 0.75 to 1.25 in steps of 0.05.
Unlike there, a plan may also name anthropometric profiles and sample random bodies.
"""

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase

import numpy as np

from pacmo_core.augmentation.bodies import (
    UNIFORM,
    BodyBones,
    Population,
    Scales,
    profile_scales,
    sample_scales,
    segment_scales,
)
from pacmo_core.augmentation.solutions import (
    OWN_WEIGHTS,
    Solution,
    SolutionSettings,
    draw_solutions,
)

PEOPLE = ("a", "b")
UPPER_BODY = "upper"  # in place of a pattern: all bones above the hips


@dataclass(frozen=True, kw_only=True)
class SingleBones:
    """Variations of one bone alone.

    Parameters
    ----------
    bones : patterns of segment names, or ``upper`` for all above the hips
    scales : of the bone; 1 is omitted
    max_variations : of a source; those with the lowest hashes
    """

    bones: tuple[str, ...]
    scales: tuple[float, ...]
    max_variations: int


@dataclass(frozen=True, kw_only=True)
class Plan:
    """The target bodies of every source.

    Parameters
    ----------
    people : ``a``, ``b``: persons whose body changes, one at a time
    uniform : scales of the whole body; 1 is omitted
    single : one bone at a time
    profiles : names of ``bodies.PROFILES``
    n_random : number of random pairs of bodies, of both people at once
    population : distribution of the random bodies
    solutions : of each pair of bodies

    Raises
    ------
    ValueError
        If a person is unknown, or a scale is not a positive number.
    """

    people: tuple[str, ...]
    uniform: tuple[float, ...]
    single: SingleBones
    profiles: tuple[str, ...]
    n_random: int
    population: Population
    solutions: SolutionSettings

    def __post_init__(self) -> None:
        if not set(self.people) <= set(PEOPLE):
            raise ValueError(f"people must be of {', '.join(PEOPLE)}; got {', '.join(self.people)}")
        for scale in (*self.uniform, *self.single.scales):
            check_scale("scales of a plan", scale)


@dataclass(frozen=True)
class Variation:
    """A pair of target bodies, and how the solver is to treat them.

    Parameters
    ----------
    name : unique in its plan, such as ``b-left_forearm-1.20``; ``b-left_forearm-1.20-2`` is the
        second further solution of these bodies
    kind : ``uniform``, ``single``, ``profile`` or ``random``
    scales : two of (E,), bone scales of person a and of person b relative to the source
    solution : factors on the solver's weights
    """

    name: str
    kind: str
    scales: tuple[Scales, Scales]
    solution: Solution = OWN_WEIGHTS

    @property
    def is_changed(self) -> bool:
        """Whether any bone differs from the source's."""
        return any((scales != 1).any() for scales in self.scales)


def plan_variations(
    plan: Plan, bodies: tuple[BodyBones, BodyBones], source: str
) -> list[Variation]:
    """List the variations of one source, sorted by name.

    Parameters
    ----------
    bodies : of person a and of person b
    source : its name, from which single bones are selected

    Raises
    ------
    ValueError
        If a pattern matches no segment, or a profile does not apply.
    """
    variations = [
        *_whole_body_variations(plan, bodies),
        *_single_bone_variations(plan, bodies, source),
        *_random_variations(plan, bodies),
    ]
    by_name = {
        several.name: several
        for variation in variations
        if variation.is_changed
        for several in _solutions_of(variation, draw_solutions(plan.solutions, source))
    }
    return [by_name[name] for name in sorted(by_name)]


def _solutions_of(variation: Variation, solutions: Sequence[Solution]) -> Iterator[Variation]:
    for solution in solutions:
        suffix = f"-{solution.number}" if solution.number else ""
        yield replace(variation, name=variation.name + suffix, solution=solution)


def check_scale(what: str, scale: float) -> None:
    """Check a bone scale.

    Raises
    ------
    ValueError
        If it is not a positive number.
    """
    if not (np.isfinite(scale) and scale > 0):
        raise ValueError(f"{what} must be positive numbers; got {scale}")


def _whole_body_variations(plan: Plan, bodies: tuple[BodyBones, BodyBones]) -> Iterator[Variation]:
    """Change all bones of one body: uniformly, or to a profile."""
    for person in plan.people:
        index = PEOPLE.index(person)
        for scale in plan.uniform:
            scales = _for_person(bodies, index, segment_scales(bodies[index], {UNIFORM: scale}))
            yield Variation(f"{person}-{UNIFORM}-{_format_scale(scale)}", "uniform", scales)
        for name in plan.profiles:
            scales = _for_person(bodies, index, profile_scales(bodies[index], name))
            yield Variation(f"{person}-{name}", "profile", scales)


def _single_bone_variations(
    plan: Plan, bodies: tuple[BodyBones, BodyBones], source: str
) -> list[Variation]:
    """Change one bone of one body; the variations with the lowest hashes."""
    variations = []
    for person in plan.people:
        index = PEOPLE.index(person)
        for bone in _matching_segments(bodies[index], plan.single.bones):
            for scale in plan.single.scales:
                scales = _for_person(bodies, index, segment_scales(bodies[index], {bone: scale}))
                name = f"{person}-{bone}-{_format_scale(scale)}"
                variations.append(Variation(name, "single", scales))

    def rank(variation: Variation) -> bytes:
        text = f"{plan.population.random_seed}\0{source}\0{variation.name}"
        return hashlib.blake2b(text.encode(), digest_size=8).digest()

    changed = [variation for variation in variations if variation.is_changed]
    return sorted(changed, key=rank)[: plan.single.max_variations]


def _random_variations(plan: Plan, bodies: tuple[BodyBones, BodyBones]) -> Iterator[Variation]:
    """Sample the bodies of both people."""
    for number in range(plan.n_random):
        name = f"r{number:04d}"
        a, b = (
            sample_scales(body, plan.population, f"{name}\0{person}")
            for body, person in zip(bodies, PEOPLE, strict=True)
        )
        yield Variation(name, "random", (a, b))


def _matching_segments(body: BodyBones, patterns: tuple[str, ...]) -> list[str]:
    """List the segments that match a pattern, each once."""
    selected: dict[str, None] = {}
    for pattern in patterns:
        matches = [
            s.name
            for s in body.segments
            if (s.is_upper if pattern == UPPER_BODY else fnmatchcase(s.name, pattern))
        ]
        if not matches:
            raise ValueError(
                f"no segment matches {pattern!r}; there are {UPPER_BODY}, {body.names}"
            )
        selected |= dict.fromkeys(matches)
    return list(selected)


def _for_person(
    bodies: tuple[BodyBones, BodyBones], index: int, scales: Scales
) -> tuple[Scales, Scales]:
    """Return the scales of both people where only one changes."""
    both = [np.ones(len(body.segments)) for body in bodies]
    both[index] = scales
    return both[0], both[1]


def _format_scale(scale: float) -> str:
    """Format a scale with two decimals, or in full where these are not exact."""
    return f"{scale:.2f}" if float(f"{scale:.2f}") == scale else repr(scale)
