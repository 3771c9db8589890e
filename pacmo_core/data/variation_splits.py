"""The four train/validation/test splits of the evaluation, and splits of fewer training samples.

The supplement (2.4) defines only the cross-scale-interaction split: test on scales [0.75, 0.85] and
[1.15, 1.25] of one motion, train on [0.95, 1.05] of other motions of the same skeleton. The other
splits follow from their names. Scales 0.90 and 1.10, which it does not use, are for validation.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

SPLITS = ("train", "validation", "test", "dropped")
# Deviations from scale 1: near up to the first, far beyond the second; scales are 0.05 apart.
NEAR, FAR = 0.075, 0.125
# Training sources from which on whole ones are set aside for validation.
MIN_SOURCES = 4


@dataclass(frozen=True)
class VariationScales:
    """The properties of a variation that determine its split.

    Parameters
    ----------
    source : name of the source clip
    scales : (2, E), of both people's bones
    """

    source: str
    scales: NDArray[np.float64]

    @property
    def max_deviation(self) -> float:
        """Largest deviation of a scale from 1."""
        return float(np.abs(self.scales - 1).max())

    @property
    def scale_group(self) -> str:
        """``near``, ``middle`` or ``far``, by the largest deviation from scale 1."""
        if self.max_deviation < NEAR:
            return "near"
        return "far" if self.max_deviation > FAR else "middle"


@dataclass(frozen=True, kw_only=True)
class SplitSettings:
    """Settings of all splits.

    Parameters
    ----------
    held_out : the sources that the cross-interaction splits test
    test_share : of variations, in the random split
    validation_share : of the training variations, in splits that do not select validation by scale;
        across interactions, of the training sources if there are enough
    random_seed : int
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
    method: str, variations: Sequence[VariationScales], settings: SplitSettings
) -> list[str]:
    """Assign each variation to ``train``, ``validation``, ``test`` or ``dropped``.

    Raises
    ------
    ValueError
        If there is no such method, a held-out source does not exist, or the training or test split
        is empty.
    """
    if method not in SPLIT_METHODS:
        raise ValueError(f"split must be one of {', '.join(SPLIT_METHODS)}; got {method!r}")
    unknown = sorted(settings.held_out - {variation.source for variation in variations})
    if unknown:
        raise ValueError(f"held_out must be sources; {unknown} are not")
    splits = SPLIT_METHODS[method](variations, settings)
    for split in ("train", "test"):
        if split not in splits:
            raise ValueError(f"split {method}: nothing to {split} on among {len(variations)}")
    return splits


def limit_training_samples(splits: Sequence[str], n: int, *, random_seed: int) -> list[str]:
    """Select n training variations at random and drop the others; selections are nested in n.

    Raises
    ------
    ValueError
        If there are fewer training variations.
    """
    rows = [row for row, split in enumerate(splits) if split == "train"]
    if not 0 < n <= len(rows):
        raise ValueError(f"training samples must be 1 to {len(rows)}; got {n}")
    selected = {rows[i] for i in np.random.default_rng(random_seed).permutation(len(rows))[:n]}
    return [
        "dropped" if split == "train" and row not in selected else split
        for row, split in enumerate(splits)
    ]


def _random_split(variations: Sequence[VariationScales], settings: SplitSettings) -> list[str]:
    order = np.random.default_rng(settings.random_seed).permutation(len(variations))
    n_test = max(1, round(settings.test_share * len(variations)))
    splits = np.full(len(variations), "train", dtype=object)
    splits[order[:n_test]] = "test"
    return _add_validation(splits.tolist(), settings)


def _cross_scale(variations: Sequence[VariationScales], settings: SplitSettings) -> list[str]:
    del settings
    splits = {"near": "train", "middle": "validation", "far": "test"}
    return [splits[variation.scale_group] for variation in variations]


def _cross_interaction(variations: Sequence[VariationScales], settings: SplitSettings) -> list[str]:
    """Hold sources out; of enough training sources, validate on whole ones, as the test does."""
    sources = sorted({v.source for v in variations} - settings.held_out)
    if len(sources) < MIN_SOURCES or not settings.validation_share:
        splits = ["test" if v.source in settings.held_out else "train" for v in variations]
        return _add_validation(splits, settings)
    order = np.random.default_rng(settings.random_seed + 1).permutation(len(sources))
    n_validation = max(1, round(settings.validation_share * len(sources)))
    validation = {sources[i] for i in order[:n_validation]}
    split_of = dict.fromkeys(settings.held_out, "test") | dict.fromkeys(validation, "validation")
    return [split_of.get(v.source, "train") for v in variations]


def _cross_scale_interaction(
    variations: Sequence[VariationScales], settings: SplitSettings
) -> list[str]:
    others = {"near": "train", "middle": "validation", "far": "dropped"}
    held_out = {"near": "dropped", "middle": "dropped", "far": "test"}
    return [
        (held_out if variation.source in settings.held_out else others)[variation.scale_group]
        for variation in variations
    ]


def _add_validation(splits: list[str], settings: SplitSettings) -> list[str]:
    rows = [row for row, split in enumerate(splits) if split == "train"]
    order = np.random.default_rng(settings.random_seed + 1).permutation(len(rows))
    for i in order[: round(settings.validation_share * len(rows))]:
        splits[rows[i]] = "validation"
    return splits


SPLIT_METHODS: dict[str, Callable[[Sequence[VariationScales], SplitSettings], list[str]]] = {
    "random": _random_split,
    "cross_scale": _cross_scale,
    "cross_interaction": _cross_interaction,
    "cross_scale_interaction": _cross_scale_interaction,
}
