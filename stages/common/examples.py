"""The variations of a dataset, as examples that a skeleton prior learns from."""

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from pacmo_core.data.names import sort_clips
from pacmo_core.skeleton_prior.data import Example
from pacmo_core.skeleton_prior.splits import VariationScales
from pacmo_core.store.motions import motion_file, read_motion, stream_motions
from pacmo_core.store.tables import (
    ACCEPTED,
    SOURCES,
    VARIATIONS,
    SplitRecord,
    VariationRecord,
    read_rows,
    read_variations,
)


def read_variation_facts(dataset: Path) -> dict[str, VariationScales]:
    """Read what a split knows of the variations that are good enough to learn from."""
    rows = read_variations(dataset / VARIATIONS)
    return {
        row.variation: VariationScales(row.clip, _bone_scales(row)) for row in rows if row.accepted
    }


def stream_examples(dataset: Path, splits: Path, split: str) -> Iterator[tuple[str, Example]]:
    """Yield the variations of one split with their names, in order.

    Raises
    ------
    ValueError
        If the table of splits is of other variations.
    """
    facts = read_variation_facts(dataset)
    stands: Mapping[str, str] = {row.clip: row.split for row in read_rows(splits, SplitRecord)}
    if facts.keys() != stands.keys():
        odd = min(facts.keys() ^ stands.keys())
        raise ValueError(
            f"{splits} wanted a split for each variation of {dataset}; differ in {odd}"
        )
    expected = {fact.source for name, fact in facts.items() if stands[name] == split}
    for clip in sort_clips(expected):
        source = read_motion(motion_file(dataset / SOURCES, clip), clip)
        for name, varied in stream_motions(motion_file(dataset / ACCEPTED, clip)):
            if stands[name] == split:
                yield name, Example(clip, source, facts[name].scales, varied)


def _bone_scales(row: VariationRecord) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    return np.array([list(row.scales_a.values()), list(row.scales_b.values())], dtype=np.float64)
