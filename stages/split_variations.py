"""Say on which side each variation stands, in every split of every family.

Usage: python -m stages.split_variations VARIATIONS SIDES METRICS.json

VARIATIONS holds a folder a family. SIDES will hold FAMILY/SPLIT.parquet.
"""

import argparse
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

from pacmo_core.skeleton_prior.splits import (
    SPLITS,
    SplitSettings,
    VariationScales,
    assign_splits,
    limit_training_samples,
)
from pacmo_core.store.tables import SplitRecord, write_rows
from stages._examples import kept_facts
from stages._files import write_json
from stages._params import read_params
from stages._priors import read_priors, split_and_samples


@dataclass(frozen=True)
class Params:
    """The ``split_variations`` section of ``params.yaml``."""

    held_out: tuple[str, ...]  # patterns of the sources that splits across interactions test
    test_share: float  # of variations, in the random split
    validation_share: float  # of those left, where scales do not choose them
    random_seed: int


def main(paths: argparse.Namespace) -> None:
    params = read_params("split_variations", Params)
    counts: dict[str, dict[str, dict[str, int]]] = {}
    paths.sides.mkdir(parents=True, exist_ok=True)
    for family, name in read_priors().groups():
        facts = kept_facts(paths.variations / family)
        sides = sides_of(facts, name, params)
        rows = [SplitRecord(variation, side) for variation, side in sides.items()]
        write_rows(paths.sides / family / f"{name}.parquet", SplitRecord, rows)
        found = Counter(sides.values())
        counts.setdefault(family, {})[name] = {side: found[side] for side in SPLITS}
    write_json(paths.metrics, counts)


def sides_of(facts: Mapping[str, VariationScales], name: str, params: Params) -> dict[str, str]:
    """Put a family's variations on sides."""
    kind, samples = split_and_samples(name)
    sources = {fact.source for fact in facts.values()}
    settings = SplitSettings(
        held_out=frozenset(
            source
            for source in sources
            if any(fnmatchcase(source, pattern) for pattern in params.held_out)
        ),
        test_share=params.test_share,
        validation_share=params.validation_share,
        random_seed=params.random_seed,
    )
    sides = assign_splits(kind, list(facts.values()), settings)
    if samples is not None:
        sides = limit_training_samples(sides, samples, random_seed=params.random_seed)
    return dict(zip(facts, sides, strict=True))


def arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser()
    for name in ("variations", "sides", "metrics"):
        parser.add_argument(name, type=Path)
    return parser.parse_args()


if __name__ == "__main__":
    main(arguments())
