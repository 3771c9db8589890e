"""Trusted: the metrics one by one, on all samples; a row of the real reactions is zero."""

from dataclasses import asdict, replace

import numpy as np
import pytest

from pacmo_core.metrics.displacement import ape, ave
from pacmo_core.metrics.f2id import f2id, midpoint_grid
from pacmo_core.metrics.mmd import median_bandwidth, mmd_a, mmd_s
from pacmo_core.metrics.partners import wrong_partners
from pacmo_core.metrics.resampling import stack_motions, to_length
from pacmo_core.metrics.table import compare_rows, measure_rows, score_rows
from pacmo_core.metrics.yardstick import Settings
from tests.metrics.problems import reactions

SETTINGS = Settings(
    n_samples=60, repeats=3, bootstrap=40, confidence=0.9, n_frames=6, root=1, random_seed=7
)
_, WEIGHTS = midpoint_grid(6)
METRICS = {
    *("f2id", "f2id_published", "f2id_floor", "f2id_halves"),
    *("mmd_a", "mmd_s", "mmd_a_published", "mmd_s_published"),
    *("diversity", "diversity_l2", "diversity_published"),
    *("ape", "ave", "ape_joints", "ave_joints"),
}


def blurred(real, size, rng):
    moved = [(m + size * rng.normal(size=(1, 1, 3))).astype(np.float32) for m in real.motions]
    return replace(
        real, motions=moved, features=real.features + size * rng.normal(size=real.features.shape)
    )


@pytest.fixture(scope="module")
def sets():
    rng = np.random.default_rng(0)
    real, train = reactions(12, "test", rng), reactions(40, "train", rng)
    return real, train, {"near": blurred(real, 0.1, rng), "far": blurred(real, 2.0, rng)}


@pytest.fixture(scope="module")
def measured(sets):
    real, train, rows = sets
    return measure_rows(real, rows, train=train, weights=WEIGHTS, settings=SETTINGS)


def test_every_row_has_every_metric_with_its_bounds_in_order(measured):
    table, _ = measured
    assert set(table) == {"real", "near", "far"}
    for metrics in table.values():
        assert set(metrics) == METRICS
        for found in metrics.values():
            assert asdict(found).keys() == {"mean", "low", "high"}
            assert np.isfinite([found.mean, found.low, found.high]).all()
            assert found.low <= found.high
            assert isinstance(found.mean, float)


def test_plain_values_are_those_of_the_metrics_called_alone(sets, measured):
    real, _, rows = sets
    table, row = measured[0]["far"], rows["far"]
    x, y = (stack_motions(part.motions, part.times, 6) for part in (real, row))
    clips = np.arange(24) // 2
    flat = [a.reshape(24, 1, -1) for a in (x, y)]
    expected = {
        "f2id": f2id(real.features, row.features, WEIGHTS),
        "mmd_a": mmd_a(x, y, clips, clips, bandwidth=median_bandwidth(x)),
        "mmd_s": mmd_s(x, y, clips, clips, bandwidth=median_bandwidth(flat[0])),
        "ape": ape(row.motions, real.motions, weighting="sequence")[1],
        "ave": ave(row.motions, real.motions, weighting="sequence")[1],
        "ape_joints": ape(row.motions, real.motions, weighting="sequence").mean(),
        "ave_joints": ave(row.motions, real.motions, weighting="sequence").mean(),
    }
    assert {name: table[name].mean for name in expected} == pytest.approx(expected, abs=1e-10)


def test_diversity_is_the_mean_over_all_pairs_of_different_clips(sets, measured):
    real, _, rows = sets
    features = rows["near"].features
    squared = [
        (WEIGHTS * (features[i] - features[j]) ** 2).sum()
        for i in range(24)
        for j in range(24)
        if real.clips[i] != real.clips[j]
    ]
    table = measured[0]["near"]
    assert table["diversity"].mean == pytest.approx(np.mean(squared))
    assert table["diversity_l2"].mean == pytest.approx(np.mean(np.sqrt(squared)))


def test_the_real_reactions_as_a_row_are_at_no_distance_from_themselves(sets):
    real, train, _ = sets
    table = score_rows(real, {"copy": real}, train=train, weights=WEIGHTS, settings=SETTINGS)
    for name in ("f2id", "mmd_a", "mmd_s", "ape", "ave", "ape_joints", "ave_joints"):
        for bound in asdict(table["copy"][name]).values():
            assert bound == pytest.approx(0, abs=1e-9), name


def test_reactions_dealt_to_wrong_partners_are_still_the_same_motions(sets):
    real, train, _ = sets
    chosen = wrong_partners(real.clips, None, np.random.default_rng(0))
    dealt = real.take(chosen)
    on_time = [
        to_length(m, t, len(n)).astype(np.float32)
        for m, t, n in zip(dealt.motions, dealt.times, real.motions, strict=True)
    ]
    row = replace(dealt, motions=on_time, partners=real.partners, times=real.times)
    table = score_rows(real, {"wrong": row}, train=train, weights=WEIGHTS, settings=SETTINGS)
    assert table["wrong"]["ape"].low > 0
    # Resampled to the partner's frames and then to the common ones, motions blur a little.
    assert abs(table["wrong"]["mmd_s"].mean) < 0.02
    assert table["wrong"]["diversity"].mean == pytest.approx(
        table["real"]["diversity"].mean, rel=0.3
    )


def test_a_paired_difference_tells_a_near_row_from_a_far_one(measured):
    table, estimates = measured
    found = compare_rows(estimates, "far", "near", 0.9)
    assert {"f2id", "mmd_a", "ape"} <= set(found)
    assert found["f2id"].low > 0
    assert found["ape"].low > 0
    assert found["ape"].mean == pytest.approx(table["far"]["ape"].mean - table["near"]["ape"].mean)


def test_the_floor_is_the_f2id_of_the_second_draw_and_halves_stand_higher(measured):
    table, _ = measured
    assert table["near"]["f2id_floor"] == table["real"]["f2id"] == table["far"]["f2id_floor"]
    assert table["real"]["f2id_halves"].mean > table["real"]["f2id"].mean
    assert table["real"]["ape"].high == table["real"]["ave_joints"].high == 0


def test_one_random_seed_gives_one_table(sets):
    real, train, rows = sets
    settings = replace(SETTINGS, bootstrap=5)
    tables = [
        score_rows(real, rows, train=train, weights=WEIGHTS, settings=s)
        for s in (settings, settings, replace(settings, random_seed=8))
    ]
    assert tables[0] == tables[1] != tables[2]


def test_a_table_of_mistaken_rows_is_refused(sets):
    real, train, rows = sets
    wanted = {"train": train, "weights": WEIGHTS, "settings": SETTINGS}
    with pytest.raises(ValueError, match="row real"):
        score_rows(real, {"real": real}, **wanted)
    with pytest.raises(ValueError, match="row far: wanted 24 reactions"):
        score_rows(real, {"far": rows["far"].take(np.arange(5))}, **wanted)
    with pytest.raises(ValueError, match="clips must be"):
        score_rows(real, {"far": train.take(np.arange(24))}, **wanted)
    with pytest.raises(ValueError, match="share no clip"):
        score_rows(real, {}, **wanted | {"train": real})
    with pytest.raises(ValueError, match="24; got 20"):
        score_rows(real, {}, **wanted | {"train": train.take(np.arange(20))})


def test_reactions_must_agree_in_number_shape_and_be_finite(sets):
    real = sets[0]
    with pytest.raises(ValueError, match=r"n > 0 motions"):
        replace(real, clips=real.clips[1:])
    with pytest.raises(ValueError, match="sample 0: wanted motion and partner"):
        replace(real, partners=[real.partners[0][1:], *real.partners[1:]])
    broken = real.motions[3].copy()
    broken[0, 0, 0] = np.nan
    with pytest.raises(ValueError, match="sample 3"):
        replace(real, motions=[*real.motions[:3], broken, *real.motions[4:]])
    features = real.features.copy()
    features[5] = np.inf
    with pytest.raises(ValueError, match="sample 5"):
        replace(real, features=features)
