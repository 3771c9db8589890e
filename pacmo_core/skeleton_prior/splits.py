"""The four splits of the evaluation, and fewer training samples, by what is known of a variation.

The supplement states the hardest one alone (2.4): test on scales [0.75, 0.85] and [1.15, 1.25] of
one motion, train on [0.95, 1.05] of others of its skeleton. The others follow from their names.
0.90 and 1.10, which it uses nowhere, choose weights.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

SPLITS = ("train", "validation", "test", "dropped")
# Departures from scale 1: up to the one is near, from the other on far; half a step of the scales.
NEAR, FAR = 0.075, 0.125


@dataclass(frozen=True)
class VariationScales:
    """What a split knows of a variation.

    Parameters
    ----------
    source : name of the motion that it varies
    scales : (2, E) of both bodies' bones
    """

    source: str
    scales: NDArray[np.float64]

    @property
    def departure(self) -> float:
        """The largest difference of a scale from 1."""
        return float(np.abs(self.scales - 1).max())

    @property
    def reach(self) -> str:
        """Near, middle or far from the template."""
        if self.departure < NEAR:
            return "near"
        return "far" if self.departure > FAR else "middle"


@dataclass(frozen=True, kw_only=True)
class SplitSettings:
    """The numbers of the splits.

    Parameters
    ----------
    held_out : the sources that the splits across interactions test
    test_share : of variations, in the random split
    validation_share : of those that are left, in splits that do not part scales
    random_seed : for the random parts
    """

    held_out: frozenset[str]
    test_share: float
    validation_share: float
    random_seed: int

    def __post_init__(self) -> None:
        if not (0 < self.test_share < 1 and 0 <= self.validation_share < 1):
            raise ValueError(
                "test_share must lie in (0, 1) and validation_share in [0, 1); "
                f"got {self.test_share}, {self.validation_share}"
            )


def assign_splits(
    kind: str, facts: Sequence[VariationScales], settings: SplitSettings
) -> list[str]:
    """Say on which side each variation stands.

    Raises
    ------
    ValueError
        If there is no such split, a held-out source is not there, or a side to train or test on
        is empty.
    """
    if kind not in SPLIT_METHODS:
        raise ValueError(f"split must be one of {', '.join(SPLIT_METHODS)}; got {kind!r}")
    unknown = sorted(settings.held_out - {fact.source for fact in facts})
    if unknown:
        raise ValueError(f"held_out must be sources; {unknown} are not")
    sides = SPLIT_METHODS[kind](facts, settings)
    for side in ("train", "test"):
        if side not in sides:
            raise ValueError(f"split {kind}: nothing to {side} on among {len(facts)} variations")
    return sides


def limit_training_samples(sides: Sequence[str], n: int, *, random_seed: int) -> list[str]:
    """Keep n of the variations to train on, drawn at random, and drop the others.

    Of two numbers the smaller one's are among the larger one's.

    Raises
    ------
    ValueError
        If there are not so many.
    """
    rows = [row for row, side in enumerate(sides) if side == "train"]
    if not 0 < n <= len(rows):
        raise ValueError(f"wanted 1 to {len(rows)} training samples; got {n}")
    kept = {rows[i] for i in np.random.default_rng(random_seed).permutation(len(rows))[:n]}
    return [
        "dropped" if side == "train" and row not in kept else side for row, side in enumerate(sides)
    ]


def _random_split(facts: Sequence[VariationScales], settings: SplitSettings) -> list[str]:
    order = np.random.default_rng(settings.random_seed).permutation(len(facts))
    n_test = max(1, round(settings.test_share * len(facts)))
    sides = np.full(len(facts), "train", dtype=object)
    sides[order[:n_test]] = "test"
    return _add_validation(sides.tolist(), settings)


def _cross_scale(facts: Sequence[VariationScales], settings: SplitSettings) -> list[str]:
    del settings
    by_reach = {"near": "train", "middle": "validation", "far": "test"}
    return [by_reach[fact.reach] for fact in facts]


def _cross_interaction(facts: Sequence[VariationScales], settings: SplitSettings) -> list[str]:
    held = settings.held_out
    return _add_validation(["test" if f.source in held else "train" for f in facts], settings)


def _cross_scale_interaction(
    facts: Sequence[VariationScales], settings: SplitSettings
) -> list[str]:
    others = {"near": "train", "middle": "validation", "far": "dropped"}
    held = {"near": "dropped", "middle": "dropped", "far": "test"}
    return [(held if f.source in settings.held_out else others)[f.reach] for f in facts]


def _add_validation(sides: list[str], settings: SplitSettings) -> list[str]:
    rows = [row for row, side in enumerate(sides) if side == "train"]
    order = np.random.default_rng(settings.random_seed + 1).permutation(len(rows))
    for i in order[: round(settings.validation_share * len(rows))]:
        sides[rows[i]] = "validation"
    return sides


SPLIT_METHODS: dict[str, Callable[[Sequence[VariationScales], SplitSettings], list[str]]] = {
    "random": _random_split,
    "cross_scale": _cross_scale,
    "cross_interaction": _cross_interaction,
    "cross_scale_interaction": _cross_scale_interaction,
}
