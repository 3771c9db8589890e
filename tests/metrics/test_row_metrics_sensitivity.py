"""Trusted: distributions in which only the partner matters, and distances measured by hand."""

from dataclasses import replace

import numpy as np
import pytest

from pacmo_core.metrics.context import EvaluationContext
from pacmo_core.metrics.controls import permute_partners
from pacmo_core.metrics.evaluate import Evaluation
from pacmo_core.metrics.mmd import median_bandwidth
from pacmo_core.metrics.plausibility import distance_functions, fit_principal_components
from pacmo_core.metrics.row_metrics import PairMmd
from tests.metrics.problems import reactions
from tests.metrics.test_evaluate_table import BODY, SETTINGS, WEIGHTS


def following(n_clips, prefix, rng):
    """Partners at random places; a reaction stands half a metre off, whatever its partner does."""
    row = reactions(n_clips, prefix, rng, further=1)
    partners = [2 * rng.normal(size=(1, 1, 3)) + 0.1 * m for m in row.motions]
    motions = [p + np.array([0.5, 0, 0]) + 0.05 * rng.normal(size=p.shape) for p in partners]
    as_float = [[m.astype(np.float32) for m in some] for some in (partners, motions)]
    return replace(row, partners=as_float[0], motions=as_float[1])


def given_away(row, rng):
    """Deal reactions of one length, so that none is stretched."""
    chosen = permute_partners(row.clips, None, rng)
    other = row.take(chosen)
    motions = [
        m[: len(p)] if len(m) >= len(p) else np.resize(m, p.shape)
        for m, p in zip(other.motions, row.partners, strict=True)
    ]
    return replace(row, motions=motions, embedded=np.stack([row.embedded[0], other.embedded[1]]))


def test_true_pairs_score_better_than_permuted_ones_if_only_the_partner_matters():
    rng = np.random.default_rng(0)
    real, train = following(20, "test", rng), following(40, "train", rng)
    table = Evaluation(real=real, train=train, weights=WEIGHTS, settings=SETTINGS)
    true, other = (table.measure(row).estimates for row in (real, given_away(real, rng)))
    for name in ("f2id_distances", "mmd_pair"):
        gap = other[name].minus(true[name])
        assert gap.plain > 0 and gap.resampled.min() > 0, name
    assert (true["matching"].minus(other["matching"])).resampled.min() > 0


def test_distances_between_bodies_do_not_change_when_both_move_together():
    rng = np.random.default_rng(1)
    row = following(4, "c", rng)
    moved = replace(
        row,
        motions=[(m + 3).astype(np.float32) for m in row.motions],
        partners=[(p + 3).astype(np.float32) for p in row.partners],
    )
    before, after = (distance_functions(r, BODY, 5) for r in (row, moved))
    assert before.shape == (8, 9, 5)
    np.testing.assert_allclose(before, after, atol=1e-4)
    expected = np.linalg.norm(row.partners[2][0, 1] - row.motions[2][0, 2])
    assert before[2, 1 * 3 + 2, 0] == pytest.approx(expected, rel=1e-6)


def test_all_components_keep_every_distance_and_few_keep_the_largest():
    functions = np.random.default_rng(2).normal(size=(30, 2, 4)) * [[[1.0], [50.0]]]
    full, few = (fit_principal_components(functions, k) for k in (8, 3))
    standard = (functions - full.mean) / full.scale
    expected = np.linalg.norm((standard[0] - standard[1]).ravel()) / 2  # √(mean over 4 instants)
    gap = np.subtract(*full.coordinates(functions)[:2])
    assert np.linalg.norm(gap) == pytest.approx(expected)
    assert few.axes.shape == (8, 3)
    np.testing.assert_allclose(np.abs(few.axes.T @ full.axes[:, :3]), np.eye(3), atol=1e-9)


@pytest.mark.parametrize("groups", [np.zeros(16, dtype=int), np.repeat([0, 1], 8)])
def test_mmd_of_permuted_pairs_is_the_mean_over_partners_and_reactions_of_each_group(groups):
    rng = np.random.default_rng(6)
    real, train = following(8, "test", rng), following(12, "train", rng)
    context = EvaluationContext(real=real, train=train, weights=WEIGHTS, settings=SETTINGS)
    partners, motions = (
        context.sequences(some, real.times)[:, 0] for some in (real.partners, real.motions)
    )
    widths = [
        median_bandwidth(context.sequences(some, train.times))
        for some in (train.partners, train.motions)
    ]

    def kernel(x, y, width):
        return np.exp(-((x[:, None] - y) ** 2).sum(axis=-1) / width)

    kernels = [kernel(x, x, w) for x, w in zip((partners, motions), widths, strict=True)]
    codes, shares = context.partners, np.bincount(groups) / 16
    within = []
    for i in range(16):
        for j in np.flatnonzero(codes != codes[i]):
            # Any two partners of these groups, and any two reactions, whoever is whose.
            both = (
                (groups[:, None] == groups[i]) & (groups == groups[j]) & (codes[:, None] != codes)
            )
            within.append(kernels[0][both].mean() * kernels[1][both].mean())
    expected = []
    for second in context.second_sets:
        others = [
            context.sequences(some, second.times)[:, 0]
            for some in (second.partners, second.motions)
        ]
        own = np.prod([kernel(x, x, w) for x, w in zip(others, widths, strict=True)], axis=0)
        clips = np.unique(second.clips, return_inverse=True)[1]
        between = [
            kernel(x, y, w) for x, y, w in zip((partners, motions), others, widths, strict=True)
        ]
        crossed = sum(
            share * np.mean(np.prod([b[groups == a].mean(axis=0) for b in between], axis=0))
            for a, share in enumerate(shares)
        )
        expected.append(np.mean(within) + own[clips[:, None] != clips].mean() - 2 * crossed)
    found = PairMmd(context).permuted(real, groups)
    assert found[0] == pytest.approx(np.mean(expected), rel=1e-6)
    assert found.shape == (41,) and np.isfinite(found).all()


def acting(n_clips, prefix, rng):
    """Two acts, each with motions of its own; within an act nobody heeds the partner."""
    row = reactions(n_clips, prefix, rng)
    acts = np.repeat(np.arange(n_clips) % 2, 2)
    partners, motions = (
        [
            (3.0 * act + rng.normal(size=3) + 0.1 * motion).astype(np.float32)
            for act, motion in zip(acts, row.motions, strict=True)
        ]
        for _ in range(2)
    )
    return replace(row, partners=partners, motions=motions), acts


def test_permuted_pairs_score_as_true_ones_if_reactions_do_not_depend_on_the_partner():
    rng, gaps, across = np.random.default_rng(7), [], []
    for _ in range(40):
        (real, acts), (train, _) = acting(6, "test", rng), acting(8, "train", rng)
        settings = replace(SETTINGS, bootstrap=1, second_samples=1)
        context = EvaluationContext(real=real, train=train, weights=WEIGHTS, settings=settings)
        pairs = PairMmd(context)
        true = pairs.measure(real)[0]
        gaps.append(pairs.permuted(real, acts)[0] - true)
        across.append(pairs.permuted(real, np.zeros(12, dtype=int))[0] - true)
    assert abs(np.mean(gaps)) < 3 * np.std(gaps) / np.sqrt(40)
    assert np.mean(across) > 5 * np.std(gaps) / np.sqrt(40)  # the act itself is seen
