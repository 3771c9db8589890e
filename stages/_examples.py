"""The variations of a family, as examples that a skeleton prior learns from."""

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from pacmo_core.skeleton_prior.examples import Example
from pacmo_core.skeleton_prior.splits import Fact
from pacmo_core.store.clips import SideFacts, read_rows
from pacmo_core.store.motions import stream_motions
from pacmo_core.store.variations import SOURCES, VARIATIONS, VariationFacts, read_variations
from stages._files import MOTIONS


def kept_facts(family: Path) -> dict[str, Fact]:
    """Read what a split knows of the variations that are good enough to learn from."""
    rows = read_variations(family / VARIATIONS)
    return {row.variation: Fact(row.clip, _scales(row)) for row in rows if row.kept}


def stream_examples(family: Path, sides: Path, side: str) -> Iterator[tuple[str, Example]]:
    """Yield the variations of one side with their names, in order.

    Raises
    ------
    ValueError
        If the table of sides is of other variations.
    """
    facts = kept_facts(family)
    stands: Mapping[str, str] = {row.clip: row.side for row in read_rows(sides, SideFacts)}
    if facts.keys() != stands.keys():
        odd = min(facts.keys() ^ stands.keys())
        raise ValueError(f"{sides} wanted a side for each variation of {family}; differ in {odd}")
    sources = dict(stream_motions(family / SOURCES))
    for name, varied in stream_motions(family / MOTIONS):
        if stands[name] == side:
            fact = facts[name]
            yield name, Example(fact.source, sources[fact.source], fact.scales, varied)


def _scales(row: VariationFacts) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    return np.array([list(row.scales_a.values()), list(row.scales_b.values())], dtype=np.float64)
