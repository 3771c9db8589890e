"""Measure every row of one fold: real motion, models, reactions permuted to wrong partners.

Usage: python -m stages.evaluate_pacmo --autoencoder DIR --matcher DIR --clips DIR --splits FILE
           --reactions DIR --scores FILE.parquet

The folder of reactions holds ROW/SEED/motions.parquet. Scores are written for every bootstrap
replicate; ``pool_pacmo`` pools them.
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np
import torch
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.names import ReactionName, sample_name
from pacmo_core.data.splits import ClipOrigin
from pacmo_core.metrics.bootstrap import resampling_unit, unit_name
from pacmo_core.metrics.context import EvaluationSettings
from pacmo_core.metrics.controls import is_permutable, permute_partners
from pacmo_core.metrics.evaluate import REAL, REAL_PAIRS, Evaluation, RowMetrics
from pacmo_core.metrics.plausibility import find_body_joints
from pacmo_core.metrics.reactions import Reactions
from pacmo_core.models import load_model
from pacmo_core.reaction import autoencoder, matcher
from pacmo_core.reaction.autoencoder import Autoencoder
from pacmo_core.reaction.data import replace_reaction, to_partner_frame
from pacmo_core.reaction.matcher import Matcher
from pacmo_core.store.files import file_hash
from pacmo_core.store.motions import stream_motions
from pacmo_core.store.scores import Score, write_scores
from stages.common.clips import clip_origin, directed_clips
from stages.common.files import MOTIONS, WEIGHTS
from stages.common.params import read_params, run_stage

Indices = NDArray[np.intp]


@dataclass(frozen=True)
class DirectedSet:
    """Interactions in the frames of their partners, in the order of the tested clips.

    Parameters
    ----------
    names : of the directed clips: clip, ``#`` and the person who reacts
    origins, actions : of each; the origin is that of the reaction
    interactions : with the first sample of each reaction
    further : with the second sample, the third, and so on
    """

    names: list[str]
    origins: list[ClipOrigin]
    actions: list[str]
    interactions: list[Interaction]
    further: list[list[Interaction]]

    @property
    def clips(self) -> list[str]:
        """The clip of each reaction."""
        return [origin.clip for origin in self.origins]

    def permuted(self, order: Indices) -> "DirectedSet":
        """Pair partner i with the reaction ``order[i]`` and the name of its clip."""
        sets = [self.interactions, *self.further]
        permuted = [
            [replace_reaction(original, some[i]) for original, i in zip(some, order, strict=True)]
            for some in sets
        ]
        origins = [self.origins[i] for i in order]
        return DirectedSet(self.names, origins, self.actions, permuted[0], permuted[1:])

    def take(self, indices: Indices) -> "DirectedSet":
        """Select by index, in that order."""
        names = [self.names[i] for i in indices]
        origins = [self.origins[i] for i in indices]
        actions = [self.actions[i] for i in indices]
        sets = [[some[i] for i in indices] for some in (self.interactions, *self.further)]
        return DirectedSet(names, origins, actions, sets[0], sets[1:])


@dataclass(frozen=True)
class Extractors:
    """The two frozen networks whose outputs the metrics compare.

    Parameters
    ----------
    unit : what the bootstrap resamples, of ``metrics.bootstrap``
    """

    autoencoder: Autoencoder
    matcher: Matcher
    unit: str

    def reactions(self, directed: DirectedSet) -> Reactions:
        """Compute features and embeddings; return a row of the evaluation."""
        features = autoencoder.encode_features(self.autoencoder, directed.interactions)
        further = [autoencoder.encode_features(self.autoencoder, some) for some in directed.further]
        return Reactions(
            features=features,
            motions=[interaction.person_b for interaction in directed.interactions],
            partners=[interaction.person_a for interaction in directed.interactions],
            times=[interaction.times for interaction in directed.interactions],
            clips=directed.clips,
            embedded=np.stack(matcher.embed(self.matcher, directed.interactions)),
            units=[unit_name(origin, self.unit) for origin in directed.origins],
            actions=directed.actions,
            further=np.array(further).reshape(len(further), *features.shape),
            further_motions=[[some.person_b for some in sample] for sample in directed.further],
        )


def real_split(clips: Path, splits: Path, split: str) -> DirectedSet:
    """Read the clips of a split in both directions."""
    directed = list(directed_clips(clips, splits, split))
    return DirectedSet(
        [name for name, _, _ in directed],
        [clip_origin(facts) for _, facts, _ in directed],
        [facts.action for _, facts, _ in directed],
        [to_partner_frame(interaction) for _, _, interaction in directed],
        [],
    )


def read_reactions(file: Path, real: DirectedSet) -> DirectedSet | None:
    """Read the reactions of a run to the tested partners; None if the file is empty.

    Raises
    ------
    ValueError
        If a partner has no reaction, or fewer samples than the others.
    """
    motions = dict(stream_motions(file))
    if not motions:
        return None
    n_samples = 1 + max(ReactionName.parse(name).sample for name in motions)
    expected = [[sample_name(name, k) for name in real.names] for k in range(n_samples)]
    missing = {name for names in expected for name in names} ^ motions.keys()
    if missing:
        raise ValueError(
            f"{file}: wanted {n_samples} reactions to each partner tested, and no others; "
            f"they differ in {min(missing)}"
        )
    sets = [[to_partner_frame(motions[name]) for name in names] for names in expected]
    return DirectedSet(real.names, real.origins, real.actions, sets[0], sets[1:])


def read_runs(reactions: Path, real: DirectedSet) -> Iterator[tuple[str, int, DirectedSet]]:
    """Yield row, seed and reactions of each ``ROW/SEED`` in a folder; empty ones are skipped."""
    files = sorted(reactions.glob(f"*/*/{MOTIONS}"))
    if not files:
        raise ValueError(f"{reactions}: wanted ROW/SEED/{MOTIONS} in it, found none")
    for file in files:
        directed = read_reactions(file, real)
        if directed is not None:
            yield file.parts[-3], int(file.parts[-2]), directed


def permutable_within_action(real: DirectedSet) -> Indices:
    """Return the indices of reactions whose action is performed in more than one clip."""
    return np.flatnonzero(is_permutable(real.clips, real.actions))


# The model whose reactions are also permuted among partners: a row with wrong partners.
PERMUTED = "pacmo"
SAME_ACTION = "_same_action"

Row = tuple[str, int, DirectedSet]
Scored = tuple[str, int, RowMetrics]


@dataclass(frozen=True)
class Params:
    """The ``evaluate_pacmo`` section of ``params.yaml``."""

    n_samples: int  # of the paper's protocol, drawn with replacement
    repeats: int  # of the paper's protocol
    bootstrap: int  # replicates of pairs of people, or recordings, for the intervals
    second_samples: int  # of real motion, for the noise floor; halves of the tested people
    n_frames: int  # common length of motions for MMD
    n_instants: int  # of the distances between bodies, as functions of time
    n_components: int  # principal components of these
    candidates: int  # partners among which the true one is picked
    smoothing: float  # seconds, of positions whose speed and jerk are measured
    body_radius: float  # metres, of the capsules around bones
    contact_distance: float  # metres between joints in contact
    met_distance: float  # metres between joints that meet a captured contact
    apart_distance: float  # metres between captured joints where a generated contact is false
    random_seed: int


def main(paths: argparse.Namespace) -> None:
    params = read_params("evaluate_pacmo", Params)
    torch.set_num_threads(1)
    # NumPy's linear algebra too: its last digits depend on the number of threads.
    with threadpool_limits(1, user_api="blas"):
        evaluate(paths, params)


def evaluate(paths: argparse.Namespace, params: Params) -> None:
    """Evaluate all rows and write their scores."""
    real, train = (real_split(paths.clips, paths.splits, split) for split in ("test", "train"))
    unit = resampling_unit(real.origins, train.origins)
    extractors = read_extractors(paths.autoencoder, paths.matcher, unit)
    model_rows = list(read_runs(paths.reactions, real))
    permuted_rows = [(row, seed, directed) for row, seed, directed in model_rows if row == PERMUTED]

    table = make_table(extractors, real, train, params)
    block = RowGroup(extractors, table, real, "")
    measured = [*block.real_rows(), *block.models(model_rows)]
    measured += block.permuted(permuted_rows, permutation(real, params.random_seed, actions=False))

    within = permutable_within_action(real)
    if len(within):
        some, permuted_rows = (
            real.take(within),
            [(row, k, directed.take(within)) for row, k, directed in permuted_rows],
        )
        group_table = (
            table if len(within) == len(real.names) else make_table(extractors, some, train, params)
        )
        block = RowGroup(extractors, group_table, some, SAME_ACTION)
        measured += [*block.real_rows()[1:], *block.models(permuted_rows)]
        measured += block.permuted(
            permuted_rows, permutation(some, params.random_seed, actions=True)
        )

    facts = {
        "autoencoder_sha256": file_hash(paths.autoencoder / WEIGHTS),
        "matcher_sha256": file_hash(paths.matcher / WEIGHTS),
        "unit": unit,
        "n": sample_counts(table, real, within),
        "absent": missing_reasons(measured),
    }
    write_scores(paths.scores, score_table(measured), facts)


def read_extractors(autoencoder_folder: Path, matcher_folder: Path, unit: str) -> Extractors:
    """Read the two frozen networks."""
    return Extractors(
        cast("Autoencoder", load_model(autoencoder_folder / WEIGHTS, "features")),
        cast("Matcher", load_model(matcher_folder / WEIGHTS, "features")),
        unit,
    )


def make_table(
    extractors: Extractors, real: DirectedSet, train: DirectedSet, params: Params
) -> Evaluation:
    """Build the evaluation of all rows."""
    features = extractors.reactions(real)
    n_points = features.features.shape[-1]
    return Evaluation(
        real=features,
        train=extractors.reactions(train),
        weights=np.full(n_points, 1 / n_points),  # midpoints of equal cells
        settings=EvaluationSettings(
            body=find_body_joints(real.interactions[0].skeleton), **vars(params)
        ),
    )


@dataclass(frozen=True)
class RowGroup:
    """Rows that are evaluated against the same real reactions.

    Parameters
    ----------
    table : the evaluation of these reactions
    real : the same reactions
    suffix : of the rows' names; if there is one, reactions are permuted within actions
    """

    extractors: Extractors
    table: Evaluation
    real: DirectedSet
    suffix: str

    def real_rows(self) -> list[Scored]:
        """Evaluate real motion: a second sample, and the tested pairs."""
        pairs = self.table.measure(self.table.context.real)
        return [(REAL, 0, self.table.real(pairs)), (REAL_PAIRS + self.suffix, 0, pairs)]

    def models(self, rows: list[Row]) -> list[Scored]:
        """Evaluate the reactions of models."""
        return [
            (row + self.suffix, k, self.table.measure(self.extractors.reactions(directed)))
            for row, k, directed in rows
        ]

    def permuted(self, rows: list[Row], order: Indices) -> list[Scored]:
        """Evaluate reactions permuted among partners: the real ones, and those of models."""
        actions = np.unique(self.real.actions, return_inverse=True)[1]
        groups = actions if self.suffix else np.zeros(len(order), dtype=np.intp)
        named = [("wrong_partner", 0, self.real)]
        named += [(f"{row}_permuted", k, directed) for row, k, directed in rows]
        return [
            (row + self.suffix, k, self._permuted(directed, order, groups))
            for row, k, directed in named
        ]

    def _permuted(self, directed: DirectedSet, order: Indices, groups: Indices) -> RowMetrics:
        original, permuted = (
            self.extractors.reactions(some) for some in (directed, directed.permuted(order))
        )
        return self.table.measure_permuted(original, permuted, groups)


def permutation(real: DirectedSet, random_seed: int, *, actions: bool) -> Indices:
    """Return a permutation of reactions among partners, of any action or of the same."""
    generator = np.random.default_rng((random_seed, int(actions)))
    return permute_partners(real.clips, real.actions if actions else None, generator)


def score_table(measured: list[Scored]) -> list[Score]:
    """Return a score for each row, seed and metric, with all replicates."""
    return [
        Score(row, seed, metric, np.array([estimate.plain, *estimate.resampled]))
        for row, seed, result in measured
        for metric, estimate in result.estimates.items()
    ]


def missing_reasons(measured: list[Scored]) -> dict[str, dict[str, str]]:
    """Return the missing metrics of each row, with the reasons."""
    return {row: result.absent for row, _, result in measured if result.absent}


def sample_counts(table: Evaluation, real: DirectedSet, within: Indices) -> dict[str, int]:
    """Count the tested reactions and clips, and the second samples."""
    seconds = table.context.second_sets
    return {
        "test_reactions": len(real.names),
        "test_clips": len({*real.clips}),
        "test_units": table.context.n_units,
        "same_action_reactions": len(within),
        "second_samples": len(seconds),
        "second_reactions": len(seconds[0]),
        "matching_candidates": table.context.candidates,
    }


def arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser()
    for name in ("autoencoder", "matcher", "clips", "splits", "reactions", "scores"):
        parser.add_argument(f"--{name}", type=Path, required=True)
    return parser.parse_args()


if __name__ == "__main__":
    run_stage(main, arguments())
