"""The accepted variations of a dataset, as training examples of skeleton priors."""

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from pacmo_core.data.names import sort_clips
from pacmo_core.data.variation_splits import VariationScales
from pacmo_core.skeleton_prior.data import Example
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
    """Read the source and the bone scales of every accepted variation, by which it is split."""
    rows = read_variations(dataset / VARIATIONS)
    return {
        row.variation: VariationScales(row.clip, _bone_scales(row)) for row in rows if row.accepted
    }


def stream_examples(dataset: Path, splits: Path, split: str) -> Iterator[tuple[str, Example]]:
    """Yield the variations of one split with their names, in order.

    Raises
    ------
    ValueError
        If the splits are of other variations.
    """
    facts = read_variation_facts(dataset)
    split_of: Mapping[str, str] = {row.clip: row.split for row in read_rows(splits, SplitRecord)}
    if facts.keys() != split_of.keys():
        differing = min(facts.keys() ^ split_of.keys())
        raise ValueError(
            f"{splits}: wanted a split for each variation of {dataset}; they differ in {differing}"
        )
    expected = {fact.source for name, fact in facts.items() if split_of[name] == split}
    for clip in sort_clips(expected):
        source = read_motion(motion_file(dataset / SOURCES, clip), clip)
        for name, varied in stream_motions(motion_file(dataset / ACCEPTED, clip)):
            if split_of[name] == split:
                yield name, Example(clip, source, facts[name].scales, varied)


def _bone_scales(row: VariationRecord) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    return np.array([list(row.scales_a.values()), list(row.scales_b.values())], dtype=np.float64)
