"""The table of metrics: every row against the real reactions, on all samples and on every draw.

Row ``real`` is real motion. Where laws of reactions are compared with those tested (F²ID, MMD,
diversity) it is a second draw: as many reactions as were tested, taken clip by clip from the
training clips. So its F²ID is the floor, ``f2id_floor`` in the report: what the metric says of two
samples of real motion of this size; where training and test differ in persons or acts, that
difference is in it. (Unlike the paper's row "Real motion", whose MMD is that of one set against
itself.) In all other metrics it is the real pairs tested, as they stand under ``real_pairs``.

====================== ============================================================================
``f2id``               between the row and the real reactions tested
``f2id_excess``        F²ID to second draws of real motion, less that of the real pairs tested
``f2id_infinity``      ``f2id`` extrapolated to infinitely many samples: see ``extrapolation``
``f2id_halves``        between two halves of the tested clips: one law, half the size
``mmd_a``, ``mmd_s``   unbiased, pairs of different clips, bandwidth by the median of real motion
``diversity``          squared distance of features, the mean over all pairs of different clips,
                       which the paper's random pairs estimate; ``diversity_l2`` is not squared
``ape``, ``ave``       of the root joint, as in the paper's tables (m, m²); ``…_joints`` of all
``f2id_distances``     F²ID to second draws of the distances between two bodies: see ``closeness``
``mmd_pair``           MMD to second draws of (partner, reaction): see ``pair_kernels``; of wrong
                       partners it is the mean over all dealings, not that of the one in the row
``matching``           how often the true partner is picked: see ``matching``
``foot_sliding``       m/s; ``penetration``, ``contact_agreement``: shares; see ``plausibility``
``multimodality``      spread of several reactions to one partner
``…_published``        by the paper's protocol: n drawn with replacement, the mean of the repeats;
                       its draws are the repeats
====================== ============================================================================

Each metric is measured on all samples and on every draw of clips: ``intervals`` says what follows.
"""

from dataclasses import dataclass

import numpy as np

from pacmo_core.metrics.f2id import f2id, flatten
from pacmo_core.metrics.floors import halves_by_clip
from pacmo_core.metrics.intervals import Array, Estimate
from pacmo_core.metrics.laws import Laws
from pacmo_core.metrics.pairs import Codes
from pacmo_core.metrics.reactions import Reactions
from pacmo_core.metrics.rows import (
    as_estimate,
    as_repeats,
    measure_displacement,
    measure_diversity,
    measure_f2id,
    measure_mmd,
    published_f2id,
)
from pacmo_core.metrics.seeing import PartnerMetrics, measure_multimodality, measure_plausibility
from pacmo_core.metrics.yardstick import Settings, Yardstick

REAL = "real"
REAL_PAIRS = "real_pairs"


@dataclass(frozen=True)
class Measured:
    """The metrics of one row, and why others are missing."""

    estimates: dict[str, Estimate]
    absent: dict[str, str]


class Table:
    """Measures rows with one yardstick.

    Parameters
    ----------
    real : the n real reactions of the test clips
    train : real reactions of other clips
    weights : (r,) quadrature weights of the features' grid, sum 1
    settings : the protocol
    """

    def __init__(
        self, *, real: Reactions, train: Reactions, weights: Array, settings: Settings
    ) -> None:
        self.yardstick = Yardstick(real=real, train=train, weights=weights, settings=settings)
        seconds = [flatten(second.features, weights) for second in self.yardstick.seconds]
        self._laws = Laws(flatten(real.features, weights), seconds, self.yardstick)
        self._partners = PartnerMetrics(self.yardstick)

    def measure(self, row: Reactions) -> Measured:
        """Measure one row.

        Parameters
        ----------
        row : n reactions, sample i answering partner i of ``real`` at the same times; its
            ``clips`` are where its motions come from, so a wrong partner's are permuted
        """
        yardstick = self.yardstick
        if len(row) != len(yardstick.real):
            raise ValueError(f"wanted {len(yardstick.real)} reactions; got {len(row)}")
        codes = yardstick.codes(row)
        plausible, reasons = measure_plausibility(row, yardstick)
        modes, missing = measure_multimodality(row, yardstick)
        return Measured(
            {
                **measure_f2id(row, self._laws, yardstick),
                **published_f2id(row, yardstick),
                **measure_mmd(row, codes, yardstick),
                **measure_diversity(row, codes, yardstick),
                **measure_displacement(row, yardstick),
                **self._partners.measure(row),
                **plausible,
                **modes,
            },
            reasons | missing,
        )

    def measure_dealt(self, row: Reactions, dealt: Reactions, groups: Codes) -> Measured:
        """Measure reactions dealt to wrong partners.

        Parameters
        ----------
        row : reactions to their own partners
        dealt : the same, dealt once
        groups : (n,) int, within which they were dealt
        """
        once = self.measure(dealt)
        return Measured(once.estimates | self._partners.dealt(row, groups), once.absent)

    def real(self, pairs: Measured) -> Measured:
        """Measure the row ``real``, given that of the real pairs tested.

        Its excess is 0 by definition; its F²ID, plain and extrapolated, is the floor.
        """
        yardstick = self.yardstick
        second, codes = yardstick.seconds[0], yardstick.codes(yardstick.seconds[0], 1)
        own = {
            "f2id": as_estimate(self._laws.floor),
            "f2id_infinity": as_estimate(self._laws.floor_infinity),
            "f2id_halves": _halves(yardstick),
            **published_f2id(second, yardstick),
            **measure_mmd(second, codes, yardstick),
            **measure_diversity(second, codes, yardstick),
        }
        return Measured(pairs.estimates | own, pairs.absent)


def _halves(yardstick: Yardstick) -> Estimate:
    """Measure F²ID between halves of the real reactions, split by clip, several times."""
    settings, features = yardstick.settings, yardstick.real.features
    generator = np.random.default_rng((settings.random_seed, 1))
    splits = (halves_by_clip(yardstick.real.clips, generator) for _ in range(settings.repeats))
    return as_repeats([f2id(features[i], features[j], yardstick.weights) for i, j in splits])
