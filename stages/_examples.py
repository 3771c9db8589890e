"""The variations of a family, as examples that a skeleton prior learns from."""

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


def kept_facts(family: Path) -> dict[str, VariationScales]:
    """Read what a split knows of the variations that are good enough to learn from."""
    rows = read_variations(family / VARIATIONS)
    return {row.variation: VariationScales(row.clip, _scales(row)) for row in rows if row.accepted}


def stream_examples(family: Path, sides: Path, side: str) -> Iterator[tuple[str, Example]]:
    """Yield the variations of one side with their names, in order.

    Raises
    ------
    ValueError
        If the table of sides is of other variations.
    """
    facts = kept_facts(family)
    stands: Mapping[str, str] = {row.clip: row.split for row in read_rows(sides, SplitRecord)}
    if facts.keys() != stands.keys():
        odd = min(facts.keys() ^ stands.keys())
        raise ValueError(f"{sides} wanted a side for each variation of {family}; differ in {odd}")
    wanted = {fact.source for name, fact in facts.items() if stands[name] == side}
    for clip in sort_clips(wanted):
        source = read_motion(motion_file(family / SOURCES, clip), clip)
        for name, varied in stream_motions(motion_file(family / ACCEPTED, clip)):
            if stands[name] == side:
                yield name, Example(clip, source, facts[name].scales, varied)


def _scales(row: VariationRecord) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    return np.array([list(row.scales_a.values()), list(row.scales_b.values())], dtype=np.float64)
