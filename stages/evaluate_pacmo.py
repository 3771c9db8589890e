"""Measure every row of one fold: real motion, models, reactions dealt to wrong partners.

Usage: python -m stages.evaluate_pacmo --autoencoder DIR --matcher DIR --clips DIR --sides FILE
           --reactions DIR --scores FILE.parquet

Below the folder of reactions stands ROW/SEED/motions.parquet. The scores are those of every draw
of clips, for ``pool_pacmo`` to pool.
"""

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np
import torch
from threadpoolctl import threadpool_limits

from pacmo_core.metrics.body import body_of
from pacmo_core.metrics.partners import wrong_partners
from pacmo_core.metrics.table import REAL, REAL_PAIRS, Measured, Table
from pacmo_core.metrics.yardstick import Settings
from pacmo_core.models import load_model
from pacmo_core.reaction.autoencoder import Autoencoder
from pacmo_core.reaction.matcher import Matcher
from pacmo_core.store.files import file_hash
from pacmo_core.store.scores import Score, write_scores
from stages._files import WEIGHTS
from stages._params import read_params
from stages._rows import Extractors, Indices, Seen, exchangeable, real_side, runs

# The model whose reactions are dealt to other partners, to learn whether it answers its own.
PERMUTED = "pacmo"
SAME_ACT = "_same_act"

Row = tuple[str, int, Seen]
Scored = tuple[str, int, Measured]


@dataclass(frozen=True)
class Params:
    """The ``evaluate_pacmo`` section of ``params.yaml``."""

    n_samples: int  # the paper's protocol: so many with replacement,
    repeats: int  # so often
    bootstrap: int  # draws of clips for the intervals
    second_draws: int  # of real motion, to hold rows against
    n_frames: int  # common length of motions for MMD
    n_instants: int  # of the distances between bodies, as functions of time
    n_components: int  # principal components of these
    candidates: int  # partners to pick the true one among
    foot_height: float  # metres above the ground; a foot below it stands
    body_radius: float  # metres between points of two bodies that merge
    contact_distance: float  # metres between joints that touch
    random_seed: int


def main(paths: argparse.Namespace) -> None:
    params = read_params("evaluate_pacmo", Params)
    torch.set_num_threads(1)
    # NumPy's linear algebra too: on another number of threads its last digits are others.
    with threadpool_limits(1, user_api="blas"):
        evaluate(paths, params)


def evaluate(paths: argparse.Namespace, params: Params) -> None:
    """Measure all rows and write their scores."""
    extractors = read_extractors(paths.autoencoder, paths.matcher)
    real, train = (real_side(paths.clips, paths.sides, side) for side in ("test", "train"))
    made = list(runs(paths.reactions, real))
    asked = [(row, seed, seen) for row, seed, seen in made if row == PERMUTED]

    table = table_of(extractors, real, train, params)
    block = Block(extractors, table, real, "")
    measured = [*block.real_rows(), *block.models(made)]
    measured += block.dealt(asked, wrong_order(real, params.random_seed, acts=False))

    within = exchangeable(real)
    if len(within):
        some, asked = real.take(within), [(row, k, seen.take(within)) for row, k, seen in asked]
        own = table if len(within) == len(real.names) else table_of(extractors, some, train, params)
        block = Block(extractors, own, some, SAME_ACT)
        measured += [*block.real_rows()[1:], *block.models(asked)]
        measured += block.dealt(asked, wrong_order(some, params.random_seed, acts=True))

    facts = {
        "autoencoder_sha256": file_hash(paths.autoencoder / WEIGHTS),
        "matcher_sha256": file_hash(paths.matcher / WEIGHTS),
        "n": counted(table, real, within),
        "absent": absences(measured),
    }
    write_scores(paths.scores, scores(measured), facts)


def read_extractors(autoencoder_folder: Path, matcher_folder: Path) -> Extractors:
    """Read the two frozen networks."""
    return Extractors(
        cast("Autoencoder", load_model(autoencoder_folder / WEIGHTS, "features")),
        cast("Matcher", load_model(matcher_folder / WEIGHTS, "features")),
    )


def table_of(extractors: Extractors, real: Seen, train: Seen, params: Params) -> Table:
    """Prepare what all rows are measured with."""
    features = extractors.reactions(real)
    n_points = features.features.shape[-1]
    return Table(
        real=features,
        train=extractors.reactions(train),
        weights=np.full(n_points, 1 / n_points),  # midpoints of equal cells
        settings=Settings(body=body_of(real.interactions[0].skeleton), **vars(params)),
    )


@dataclass(frozen=True)
class Block:
    """Rows that are measured against the same real reactions.

    Parameters
    ----------
    table : of those
    real : the same as ``table``'s
    suffix : of the rows' names; those of the same act are dealt within acts
    """

    extractors: Extractors
    table: Table
    real: Seen
    suffix: str

    def real_rows(self) -> list[Scored]:
        """Measure real motion: as a second draw, and the pairs tested."""
        pairs = self.table.measure(self.table.yardstick.real)
        return [(REAL, 0, self.table.real(pairs)), (REAL_PAIRS + self.suffix, 0, pairs)]

    def models(self, rows: list[Row]) -> list[Scored]:
        """Measure what models answered."""
        return [
            (row + self.suffix, k, self.table.measure(self.extractors.reactions(seen)))
            for row, k, seen in rows
        ]

    def dealt(self, rows: list[Row], order: Indices) -> list[Scored]:
        """Measure reactions dealt to wrong partners: the real ones, and those of models."""
        acts = np.unique(self.real.acts, return_inverse=True)[1]
        groups = acts if self.suffix else np.zeros(len(order), dtype=np.intp)
        named = [("wrong_partner", 0, self.real)]
        named += [(f"{row}_permuted", k, seen) for row, k, seen in rows]
        return [(row + self.suffix, k, self._dealt(seen, order, groups)) for row, k, seen in named]

    def _dealt(self, seen: Seen, order: Indices, groups: Indices) -> Measured:
        own, dealt = (self.extractors.reactions(some) for some in (seen, seen.dealt(order)))
        return self.table.measure_dealt(own, dealt, groups)


def wrong_order(real: Seen, random_seed: int, *, acts: bool) -> Indices:
    """Deal wrong partners, of any act or of the same."""
    generator = np.random.default_rng((random_seed, int(acts)))
    return wrong_partners(real.clips, real.acts if acts else None, generator)


def scores(measured: list[Scored]) -> list[Score]:
    """Lay out every draw."""
    return [
        Score(row, seed, metric, np.array([estimate.plain, *estimate.resampled]))
        for row, seed, found in measured
        for metric, estimate in found.estimates.items()
    ]


def absences(measured: list[Scored]) -> dict[str, dict[str, str]]:
    """Say of each row which metrics are missing, and why."""
    return {row: found.absent for row, _, found in measured if found.absent}


def counted(table: Table, real: Seen, within: Indices) -> dict[str, int]:
    """Count what the figures rest on."""
    seconds = table.yardstick.seconds
    return {
        "test_reactions": len(real.names),
        "test_clips": len({*real.clips}),
        "same_act_reactions": len(within),
        "second_draws": len(seconds),
        "second_reactions": len(seconds[0]),
        "matching_candidates": table.yardstick.candidates,
    }


def arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser()
    for name in ("autoencoder", "matcher", "clips", "sides", "reactions", "scores"):
        parser.add_argument(f"--{name}", type=Path, required=True)
    return parser.parse_args()


if __name__ == "__main__":
    main(arguments())
