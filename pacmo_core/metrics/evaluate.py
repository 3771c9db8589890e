"""Evaluate the rows of a table: every metric on all samples and on every bootstrap replicate.

Row ``real`` is real motion. In metrics that compare distributions with the tested reactions (F²ID,
MMD, diversity) it is a second sample: as many reactions as are tested, taken clip by clip from the
training clips. Its F²ID is therefore the noise floor, ``f2id_floor`` in the report: the value for
two samples of real motion of this size, including differences in people or actions between training
and test. (In the paper's row "Real motion" the MMD compares one set with itself.) In all other
metrics it is the tested real pairs, as in row ``real_pairs``.

====================== ============================================================================
``f2id``               Fréchet distance between the row and the tested real reactions: ``f2id``
``f2id_excess``        F²ID to real motion of other tested people, minus that of the tested real
                       pairs: one half of the people against the other, over several halves
``f2id_infinity``      ``f2id`` extrapolated to infinitely many samples
``f2id_halves``        between two halves of the tested clips: one distribution, half the size
``mmd_a``, ``mmd_s``   unbiased, pairs of different clips, bandwidth by the median of real motion
``diversity``          squared distance of features, the mean over all pairs of different clips,
                       which the paper's random pairs estimate; ``diversity_l2`` is not squared
``ape``, ``ave``       of the root joint, as in the paper's tables (m, m²); ``…_joints`` of all
``f2id_distances``     F²ID of the distances between two bodies to those of other tested people
``mmd_pair``           MMD to second samples of (partner, reaction); for permuted partners the mean
                       over all permutations, not that of the one in the row
``matching``           share of reactions whose true partner fits best
``contacts_met``       share of captured frames of contact that are met; ``contacts_met.ACTION`` of
                       one action, ``contacts_met_near`` with 0.1 s to spare; ``false_contacts``,
                       ``contact_f1``, ``penetration``: see ``contact``
``foot_skate``         and ``step_length``, ``ground_penetration``, ``bone_variation``, ``jerk``,
                       ``jolts``, ``lurches``: see ``plausibility``
``energy_score``       of the reactions to one partner; ``dispersion``, ``multimodality``: their
                       distance from each other, relative to the real reaction, and in features
``…_published``        by the paper's protocol: n samples with replacement, the mean of the repeats;
                       its replicates are the repeats
====================== ============================================================================
"""

from dataclasses import dataclass

import numpy as np

from pacmo_core.metrics.bootstrap import Array, Estimate
from pacmo_core.metrics.context import EvaluationContext, EvaluationSettings
from pacmo_core.metrics.controls import split_halves_by_clip
from pacmo_core.metrics.f2id import f2id, flatten
from pacmo_core.metrics.mmd import Codes
from pacmo_core.metrics.reactions import Reactions
from pacmo_core.metrics.row_metrics import (
    GaussianReference,
    PartnerMetrics,
    as_estimate,
    as_repeats,
    measure_displacement,
    measure_diversity,
    measure_f2id,
    measure_mmd,
    measure_published_f2id,
)
from pacmo_core.metrics.row_plausibility import (
    measure_contact,
    measure_multimodality,
    measure_plausibility,
    measure_samples,
)

REAL = "real"
REAL_PAIRS = "real_pairs"


@dataclass(frozen=True)
class RowMetrics:
    """The metrics of one row, and the reasons why others are missing."""

    estimates: dict[str, Estimate]
    absent: dict[str, str]


class Evaluation:
    """Evaluates rows with one context.

    Parameters
    ----------
    real : the n real reactions of the test clips
    train : real reactions of other clips
    weights : (r,) quadrature weights of the features' grid, sum 1
    settings : the protocol
    """

    def __init__(
        self, *, real: Reactions, train: Reactions, weights: Array, settings: EvaluationSettings
    ) -> None:
        self.context = EvaluationContext(real=real, train=train, weights=weights, settings=settings)
        second_sets = [flatten(second.features, weights) for second in self.context.second_sets]
        self._reference = GaussianReference(
            flatten(real.features, weights), second_sets, self.context
        )
        self._partners = PartnerMetrics(self.context)

    def measure(self, row: Reactions) -> RowMetrics:
        """Measure one row.

        Parameters
        ----------
        row : n reactions, sample i to partner i of ``real`` at the same times; ``clips`` are
            the origins of its motions, which are permuted for wrong partners
        """
        context = self.context
        if len(row) != len(context.real):
            raise ValueError(f"wanted {len(context.real)} reactions; got {len(row)}")
        codes = context.codes(row)
        parts = [
            measure_f2id(row, self._reference, context),
            self._partners.measure(row),
            measure_contact(row, context),
            measure_plausibility(row, context),
            measure_samples(row, context),
            measure_multimodality(row, context),
        ]
        estimates = {
            **measure_published_f2id(row, context),
            **measure_mmd(row, codes, context),
            **measure_diversity(row, codes, context),
            **measure_displacement(row, context),
        }
        reasons: dict[str, str] = {}
        for measured, missing in parts:
            estimates |= measured
            reasons |= missing
        return RowMetrics(estimates, reasons)

    def measure_permuted(self, row: Reactions, permuted: Reactions, groups: Codes) -> RowMetrics:
        """Measure reactions that are permuted among partners.

        Parameters
        ----------
        row : reactions with their true partners
        permuted : the same, permuted once
        groups : (n,) int, groups within which they are permuted
        """
        once = self.measure(permuted)
        return RowMetrics(once.estimates | self._partners.permuted(row, groups), once.absent)

    def real(self, pairs: RowMetrics) -> RowMetrics:
        """Measure the row ``real``, given the metrics of the tested real pairs.

        Its excess is 0 by definition; its F²ID, plain and extrapolated, is the noise floor.
        """
        context = self.context
        second, codes = context.second_sets[0], context.codes(context.second_sets[0], 1)
        second_metrics = {
            "f2id": as_estimate(self._reference.floor),
            "f2id_infinity": as_estimate(self._reference.floor_infinity),
            "f2id_halves": _halves_distance(context),
            **measure_published_f2id(second, context),
            **measure_mmd(second, codes, context),
            **measure_diversity(second, codes, context),
        }
        return RowMetrics(pairs.estimates | second_metrics, pairs.absent)


def _halves_distance(context: EvaluationContext) -> Estimate:
    """Measure F²ID between halves of the real reactions, split by clip, for each repeat."""
    settings, features = context.settings, context.real.features
    generator = np.random.default_rng((settings.random_seed, 1))
    splits = (split_halves_by_clip(context.real.clips, generator) for _ in range(settings.repeats))
    return as_repeats([f2id(features[i], features[j], context.weights) for i, j in splits])
