"""Say on which side each variation of a family stands in a split.

Usage: python -m stages.split_variations --split=NAME FAMILY SIDES.parquet METRICS.json
"""

import argparse
from collections import Counter
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

from pacmo_core.skeleton_prior.splits import SIDES, SplitSettings, fewer, split
from pacmo_core.store.clips import SideFacts, write_rows
from stages._examples import kept_facts
from stages._files import write_json
from stages._params import read_params


@dataclass(frozen=True)
class Params:
    """The ``split_variations`` section of ``params.yaml``."""

    held_out: tuple[str, ...]  # patterns of the sources that splits across interactions test
    test_share: float  # of variations, in the random split
    validation_share: float  # of those left, where scales do not choose them
    samples: int | None  # to train on; none, all
    random_seed: int


def main(paths: argparse.Namespace) -> None:
    params = read_params("split_variations", Params)
    facts = kept_facts(paths.family)
    sources = {fact.source for fact in facts.values()}
    held_out = {s for s in sources if any(fnmatchcase(s, name) for name in params.held_out)}
    settings = SplitSettings(
        held_out=frozenset(held_out),
        test_share=params.test_share,
        validation_share=params.validation_share,
        random_seed=params.random_seed,
    )
    sides = split(paths.split, list(facts.values()), settings)
    if params.samples is not None:
        sides = fewer(sides, params.samples, random_seed=params.random_seed)
    rows = [SideFacts(name, side) for name, side in zip(facts, sides, strict=True)]
    write_rows(paths.sides, SideFacts, rows)
    counts = Counter(sides)
    write_json(paths.metrics, {side: counts[side] for side in SIDES})


def arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--split", required=True)
    for name in ("family", "sides", "metrics"):
        parser.add_argument(name, type=Path)
    return parser.parse_args()


if __name__ == "__main__":
    main(arguments())
