"""Measure every row of the table: real motion, oracle, models, real reactions to wrong partners.

Usage: python -m stages.evaluate_pacmo --autoencoder DIR --clips DIR --sides FILE --reactions DIR
           --scores FILE

One seed of each row.
"""

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from pacmo_core.interaction import Interaction
from pacmo_core.metrics.intervals import Interval
from pacmo_core.metrics.partners import wrong_partners
from pacmo_core.metrics.reactions import Reactions
from pacmo_core.metrics.table import compare_rows, measure_rows
from pacmo_core.metrics.yardstick import Settings
from pacmo_core.pacmo import autoencoder
from pacmo_core.pacmo.autoencoder import Autoencoder
from pacmo_core.pacmo.facing import dealt_to, seen_from_partner
from pacmo_core.store.motions import stream_motions
from pacmo_core.store.weights import file_hash, read_weights
from stages._files import MOTIONS, WEIGHTS, write_json
from stages._params import read_params
from stages._reactions import directed_clips


@dataclass(frozen=True)
class Params:
    """The ``evaluate_pacmo`` section of ``params.yaml``."""

    n_samples: int  # the paper's protocol: so many with replacement,
    repeats: int  # so often
    bootstrap: int  # draws of clips for the intervals
    confidence: float
    n_frames: int  # common length of motions for MMD
    random_seed: int


@dataclass(frozen=True)
class Seen:
    """Interactions seen from their partners, and the clip of each."""

    clips: list[str]
    interactions: list[Interaction]


def main(autoencoder_folder: Path, clips: Path, sides: Path, folder: Path, scores: Path) -> None:
    params = read_params("evaluate_pacmo", Params)
    torch.set_num_threads(1)
    weights = autoencoder_folder / WEIGHTS
    config, state = read_weights(weights)
    extractor = autoencoder.from_state(config["model"], state)

    test, train = (real_side(clips, sides, side) for side in ("test", "train"))
    candidates = {"wrong_partner": with_wrong_partners(test, params.random_seed)}
    for row in sorted(folder.iterdir()):
        generated = reactions_in(min(row.iterdir()))
        if generated.clips:
            candidates[row.name] = generated

    real = reactions(extractor, test)
    n_points = real.features.shape[-1]
    table, estimates = measure_rows(
        real,
        {row: reactions(extractor, seen) for row, seen in candidates.items()},
        train=reactions(extractor, train),
        weights=np.full(n_points, 1 / n_points),  # midpoints of equal cells
        settings=Settings(root=test.interactions[0].skeleton.root, **vars(params)),
    )
    differences = compare_rows(estimates, "pacmo", "gru", params.confidence)
    write_json(
        scores,
        {
            "extractor_sha256": file_hash(weights),
            "test_reactions": len(real),
            "rows": {row: as_json(found) for row, found in table.items()},
            "pacmo_minus_gru": as_json(differences),
        },
    )


def real_side(clips: Path, sides: Path, side: str) -> Seen:
    """See the recorded clips of a side from either person."""
    found = [
        (facts.clip, seen_from_partner(i)) for _, facts, i in directed_clips(clips, sides, side)
    ]
    return Seen([clip for clip, _ in found], [interaction for _, interaction in found])


def reactions_in(folder: Path) -> Seen:
    """See the generated reactions of a folder; none if the folder's model makes none here."""
    found = {n: i for n, i in stream_motions(folder / MOTIONS) if n.endswith("#0")}
    clips = [name.rsplit("#", 2)[0] for name in found]
    return Seen(clips, [seen_from_partner(interaction) for interaction in found.values()])


def with_wrong_partners(seen: Seen, random_seed: int) -> Seen:
    """Deal the real reactions among the partners so that none keeps its own."""
    order = wrong_partners(seen.clips, None, np.random.default_rng(random_seed))
    dealt = zip(seen.interactions, (seen.interactions[i] for i in order), strict=True)
    return Seen([seen.clips[i] for i in order], [dealt_to(own, other) for own, other in dealt])


def reactions(extractor: Autoencoder, seen: Seen) -> Reactions:
    """Add the features, as the metrics want a row."""
    return Reactions(
        features=autoencoder.features(extractor, seen.interactions),
        motions=[interaction.person_b for interaction in seen.interactions],
        partners=[interaction.person_a for interaction in seen.interactions],
        times=[interaction.times for interaction in seen.interactions],
        clips=seen.clips,
    )


def as_json(metrics: dict[str, Interval]) -> dict[str, dict[str, float]]:
    """Round to what the intervals support, so that equal figures read equal."""
    return {
        name: {part: float(f"{value:.6g}") for part, value in vars(interval).items()}
        for name, interval in metrics.items()
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    for argument in ("autoencoder", "clips", "sides", "reactions", "scores"):
        parser.add_argument(f"--{argument}", type=Path, required=True)
    paths = parser.parse_args()
    main(paths.autoencoder, paths.clips, paths.sides, paths.reactions, paths.scores)
