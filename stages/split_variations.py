"""Assign each variation to train, validation or test, in every split of every dataset.

Usage: python -m stages.split_variations VARIATIONS SPLITS METRICS.json

VARIATIONS holds a folder a dataset. SPLITS will hold DATASET/SPLIT.parquet.
"""

import argparse
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from pacmo_core.data.names import matches_any, sort_clips
from pacmo_core.data.variation_splits import (
    SPLITS,
    SplitSettings,
    VariationScales,
    assign_splits,
    limit_training_samples,
)
from pacmo_core.store.tables import VARIATIONS, SplitRecord, write_rows
from stages.common.examples import read_variation_facts
from stages.common.files import write_json
from stages.common.params import (
    StageError,
    parse_split_name,
    read_params,
    read_prior_runs,
    run_stage,
)

ACROSS_INTERACTIONS = ("cross_interaction", "cross_scale_interaction")  # hold out sources


@dataclass(frozen=True)
class Params:
    """The ``split_variations`` section of ``params.yaml``."""

    held_out: tuple[str, ...]  # patterns of the sources that splits across interactions test
    n_folds: int  # into which sources are divided where splits are named by fold
    folds: tuple[tuple[str, ...], ...]  # instead, patterns of the sources that each fold tests
    test_share: float  # of variations, in the random split
    validation_share: float  # of those left, where scales do not choose them
    random_seed: int


def main(paths: argparse.Namespace) -> None:
    params = read_params("split_variations", Params)
    counts: dict[str, dict[str, dict[str, int]]] = {}
    paths.splits.mkdir(parents=True, exist_ok=True)
    for dataset, name in read_prior_runs().groups():
        if not (paths.variations / dataset / VARIATIONS).exists():
            raise StageError(
                f"runs.priors.datasets: {paths.variations} has no variations of {dataset}; "
                "wanted the dataset of ingest, or [] to train no skeleton priors"
            )
        facts = read_variation_facts(paths.variations / dataset)
        try:
            splits = assign(facts, name, params)
        except ValueError as fault:  # of the section, which the user wrote
            raise StageError(
                f"{dataset}: {fault}; runs.priors.splits lists the splits, and "
                f"split_variations says what each tests: held_out is {', '.join(params.held_out)}"
            ) from fault
        rows = [SplitRecord(variation, split) for variation, split in splits.items()]
        write_rows(paths.splits / dataset / f"{name}.parquet", SplitRecord, rows)
        counts_of_split = Counter(splits.values())
        counts.setdefault(dataset, {})[name] = {split: counts_of_split[split] for split in SPLITS}
    write_json(paths.metrics, counts)


def assign(facts: Mapping[str, VariationScales], name: str, params: Params) -> dict[str, str]:
    """Assign a dataset's variations; all solutions of one pair of bodies alike."""
    body_of = {row: (fact.source, fact.scales.tobytes()) for row, fact in facts.items()}
    bodies = {body: facts[row] for row, body in body_of.items()}
    split_of = dict(zip(bodies, _assign_bodies(list(bodies.values()), name, params), strict=True))
    return {row: split_of[body] for row, body in body_of.items()}


def _assign_bodies(bodies: list[VariationScales], name: str, params: Params) -> list[str]:
    split = parse_split_name(name)
    if split.fold is not None and split.kind not in ACROSS_INTERACTIONS:
        kinds = " and ".join(ACROSS_INTERACTIONS)
        raise ValueError(f"folds are of the splits {kinds}, which hold out sources")
    sources = sort_clips({body.source for body in bodies})
    settings = SplitSettings(
        held_out=held_out_sources(sources, split.fold, params),
        test_share=params.test_share,
        validation_share=params.validation_share,
        random_seed=params.random_seed,
    )
    splits = assign_splits(split.kind, bodies, settings)
    if split.samples is not None:
        splits = limit_training_samples(splits, split.samples, random_seed=params.random_seed)
    return splits


def held_out_sources(sources: Sequence[str], fold: int | None, params: Params) -> frozenset[str]:
    """Select the sources of a fold, or without one those that the patterns ``held_out`` match.

    Of a fold that ``folds`` lists, those that its patterns match; without a list every
    ``n_folds``-th.
    """
    n_folds = len(params.folds) or params.n_folds
    if fold is not None and not 1 <= fold <= n_folds:
        name = "the number of folds" if params.folds else "n_folds"
        raise ValueError(f"fold must be 1 to {name}, {n_folds}; got {fold}")
    if fold is not None and not params.folds:
        return frozenset(sources[fold - 1 :: n_folds])
    patterns = params.held_out if fold is None else params.folds[fold - 1]
    return frozenset(s for s in sources if matches_any(s, patterns))


def arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser()
    for name in ("variations", "splits", "metrics"):
        parser.add_argument(name, type=Path)
    return parser.parse_args()


if __name__ == "__main__":
    run_stage(main, arguments())
