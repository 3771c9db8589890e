"""The table of metrics: every row against the real reactions, with intervals.

Row ``real`` is a second draw of real motion: as many reactions as were tested, taken clip by clip
from the training clips. So its F²ID, MMD and diversity are what the metrics say of two samples of
real motion, and its F²ID stands as ``f2id_floor`` in every row; where training and test differ in
persons or acts, that difference is in it. Its APE and AVE are those of the real reactions
against themselves, 0. (Unlike the paper's row "Real motion", whose MMD is that of one set
against itself.) The floor is for independent samples: a row that answers the very partners of the
test clips shares their sampling error, and may lie below it. ``f2id_halves`` is the F²ID between
two halves of the test clips: of one law for certain, but of half the size, and so the larger by
bias.

============================== ====================================================================
``f2id``                       on all samples
``mmd_a``, ``mmd_s``           unbiased, pairs of different clips, bandwidth by the median of real
``diversity``, ``diversity_l2`` squared and plain distance, the mean over all pairs of different
                               clips, which the paper's random pairs estimate
``ape``, ``ave``               of the root joint, as in the paper's tables (m, m²)
``ape_joints``, ``ave_joints`` mean over all joints
``…_published``                by the paper's protocol: n drawn with replacement, the mean of the
                               repeats; low and high are the smallest and the largest repeat
============================== ====================================================================

All other intervals come from draws of clips, moved to the value on all samples: see
``intervals.interval``.
"""

from collections.abc import Mapping

import numpy as np

from pacmo_core.metrics.f2id import f2id
from pacmo_core.metrics.floors import halves_by_clip
from pacmo_core.metrics.intervals import (
    Array,
    Estimate,
    Interval,
    difference,
    interval,
    repeated,
)
from pacmo_core.metrics.reactions import Reactions
from pacmo_core.metrics.rows import measure_displacement, measure_laws
from pacmo_core.metrics.yardstick import Settings, Yardstick

# These cannot fall below zero; the unbiased MMD can.
_NOT_NEGATIVE = ("f2id", "diversity", "diversity_l2", "ape", "ave", "ape_joints", "ave_joints")

Estimates = dict[str, dict[str, Estimate]]
Table = dict[str, dict[str, Interval]]


def score_rows(
    real: Reactions,
    rows: Mapping[str, Reactions],
    *,
    train: Reactions,
    weights: Array,
    settings: Settings,
) -> Table:
    """Measure every row, and the row ``real``, against the real reactions.

    Parameters
    ----------
    real : the n real reactions of the test clips
    rows : n reactions each, sample i answering partner i of ``real`` at the same times; a
        row's ``clips`` are where its motions come from, so a wrong partner's are permuted
    train : at least n real reactions of other clips
    weights : (r,) quadrature weights of the features' grid, sum 1
    settings : the protocol

    Returns
    -------
    row to metric to interval

    Raises
    ------
    ValueError
        If a row is called ``real``, or is not of the same partners as ``real``.
    """
    return measure_rows(real, rows, train=train, weights=weights, settings=settings)[0]


def measure_rows(
    real: Reactions,
    rows: Mapping[str, Reactions],
    *,
    train: Reactions,
    weights: Array,
    settings: Settings,
) -> tuple[Table, Estimates]:
    """Do as ``score_rows``, and give the draws of clips too, for ``compare_rows``."""
    for name, row in rows.items():
        if name == "real" or len(row) != len(real):
            raise ValueError(f"row {name}: wanted {len(real)} reactions, not real; got {len(row)}")
    yardstick = Yardstick(real=real, train=train, weights=weights, settings=settings)
    table: Table = {}
    estimates: Estimates = {}
    for name, row in {"real": yardstick.second, **rows}.items():
        estimates[name], published = measure_laws(row, yardstick)
        answers = real if name == "real" else row
        estimates[name] |= measure_displacement(answers, yardstick)
        table[name] = _intervals(estimates[name], settings.confidence) | published
    floors = {"f2id_floor": table["real"]["f2id"], "f2id_halves": _halves(yardstick)}
    return {name: metrics | floors for name, metrics in table.items()}, estimates


def compare_rows(
    estimates: Estimates, first: str, second: str, confidence: float
) -> dict[str, Interval]:
    """Give the paired difference ``first`` − ``second`` of each metric, with its interval."""
    return {
        metric: difference(estimate, estimates[second][metric], confidence)
        for metric, estimate in estimates[first].items()
    }


def _intervals(estimates: dict[str, Estimate], confidence: float) -> dict[str, Interval]:
    return {
        name: interval(estimate, confidence, least=0.0 if name in _NOT_NEGATIVE else -np.inf)
        for name, estimate in estimates.items()
    }


def _halves(yardstick: Yardstick) -> Interval:
    """Measure F²ID between halves of the real reactions, split by clip, several times."""
    settings, features = yardstick.settings, yardstick.real.features
    generator = np.random.default_rng((settings.random_seed, 1))
    splits = (halves_by_clip(yardstick.real.clips, generator) for _ in range(settings.repeats))
    return repeated(
        np.array([f2id(features[i], features[j], yardstick.weights) for i, j in splits])
    )
