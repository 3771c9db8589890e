"""Trusted: the metrics one by one, on all samples; real pairs are no distance from themselves."""

from dataclasses import replace

import numpy as np
import pytest

from pacmo_core.metrics.bootstrap import interval
from pacmo_core.metrics.context import EvaluationContext, EvaluationSettings
from pacmo_core.metrics.controls import permute_partners
from pacmo_core.metrics.displacement import ape, ave
from pacmo_core.metrics.evaluate import Evaluation
from pacmo_core.metrics.f2id import f2id
from pacmo_core.metrics.mmd import median_bandwidth, mmd_a, mmd_s
from pacmo_core.metrics.plausibility import BodyJoints
from pacmo_core.metrics.reactions import stack_motions, to_length
from tests.metrics.problems import midpoint_grid, reactions

BODY = BodyJoints(
    root=1,
    keys=(0, 1, 2),
    feet=(2,),
    ankles=(2,),
    bones=np.array([[0, 1], [1, 2]]),
    shoulders=(0,),
)
SETTINGS = EvaluationSettings(
    n_samples=60,
    repeats=3,
    bootstrap=40,
    second_samples=2,
    n_frames=6,
    n_instants=5,
    n_components=4,
    candidates=8,
    smoothing=0.1,
    body_radius=0.2,
    contact_distance=0.7,
    met_distance=0.8,
    apart_distance=0.9,
    body=BODY,
    random_seed=7,
)
_, WEIGHTS = midpoint_grid(6)
METRICS = {
    *("f2id", "f2id_excess", "f2id_infinity", "f2id_published"),
    *("mmd_a", "mmd_s", "mmd_a_published", "mmd_s_published"),
    *("diversity", "diversity_l2", "diversity_published"),
    *("ape", "ave", "ape_joints", "ave_joints"),
    *("f2id_distances", "mmd_pair", "matching"),
    *("contacts_met", "contacts_met_near", "false_contacts", "contact_f1"),
    *("contacts_met.wave", "contacts_met.bow", "energy_score"),
    *("foot_skate", "step_length", "ground_penetration", "bone_variation"),
    *("jerk", "jolts", "lurches", "penetration"),
}


def blurred(real, size, rng):
    moved = [(m + size * rng.normal(size=(1, 1, 3))).astype(np.float32) for m in real.motions]
    return replace(
        real, motions=moved, features=real.features + size * rng.normal(size=real.features.shape)
    )


@pytest.fixture(scope="module")
def sets():
    rng = np.random.default_rng(0)
    real, train = reactions(16, "test", rng), reactions(40, "train", rng)
    return real, train, {"near": blurred(real, 0.1, rng), "far": blurred(real, 2.0, rng)}


def table_of(real, train, settings=SETTINGS):
    return Evaluation(real=real, train=train, weights=WEIGHTS, settings=settings)


@pytest.fixture(scope="module")
def measured(sets):
    real, train, rows = sets
    table = table_of(real, train)
    pairs = table.measure(real)
    found = {name: table.measure(row) for name, row in rows.items()}
    return {"real": table.real(pairs), "real_pairs": pairs, **found}


def values(found):
    return {name: estimate.plain for name, estimate in found.estimates.items()}


def test_every_row_has_every_metric_on_every_replicate(measured):
    for row, found in measured.items():
        assert set(found.estimates) == METRICS | ({"f2id_halves"} if row == "real" else set())
        assert found.absent == {
            "multimodality": "one reaction per partner",
            "dispersion": "one reaction per partner",
        }
        for name, estimate in found.estimates.items():
            repeats = name.endswith(("_published", "_halves"))
            assert estimate.resampled.shape == ((3,) if repeats else (40,))
            assert np.isfinite([estimate.plain, *estimate.resampled]).all()


def test_an_action_of_which_three_clips_touch_has_no_figure_of_its_own(sets):
    real, train, _ = sets
    actions = ["bow"] * 3 + ["wave"] * (len(real.motions) - 3)
    found = table_of(replace(real, actions=actions), train).measure(replace(real, actions=actions))
    assert {name for name in found.estimates if "." in name} == {"contacts_met.wave"}


def test_plain_values_are_those_of_the_metrics_called_alone(sets, measured):
    real, _, rows = sets
    found, row = values(measured["far"]), rows["far"]
    x, y = (stack_motions(part.motions, part.times, 6) for part in (real, row))
    clips = np.arange(32) // 2
    flat = [a.reshape(32, 1, -1) for a in (x, y)]
    expected = {
        "f2id": f2id(real.features, row.features, WEIGHTS),
        "mmd_a": mmd_a(x, y, clips, clips, bandwidth=median_bandwidth(x)),
        "mmd_s": mmd_s(x, y, clips, clips, bandwidth=median_bandwidth(flat[0])),
        "ape": ape(row.motions, real.motions, weighting="sequence")[1],
        "ave": ave(row.motions, real.motions, weighting="sequence")[1],
        "ape_joints": ape(row.motions, real.motions, weighting="sequence").mean(),
        "ave_joints": ave(row.motions, real.motions, weighting="sequence").mean(),
    }
    assert {name: found[name] for name in expected} == pytest.approx(expected, abs=1e-9)


def test_diversity_is_the_mean_over_all_pairs_of_different_clips(sets, measured):
    real, _, rows = sets
    features = rows["near"].features
    squared = [
        (WEIGHTS * (features[i] - features[j]) ** 2).sum()
        for i in range(32)
        for j in range(32)
        if real.clips[i] != real.clips[j]
    ]
    found = values(measured["near"])
    assert found["diversity"] == pytest.approx(np.mean(squared))
    assert found["diversity_l2"] == pytest.approx(np.mean(np.sqrt(squared)))


def test_the_real_pairs_are_at_no_distance_from_themselves(measured):
    found = measured["real_pairs"].estimates
    zero = ("f2id", "f2id_excess", "f2id_infinity", "mmd_a", "mmd_s", "ape", "ave", "ape_joints")
    for name in zero:
        np.testing.assert_allclose(found[name].resampled, 0, atol=1e-9, err_msg=name)
        assert found[name].plain == pytest.approx(0, abs=1e-9)
    assert found["contact_f1"].plain == found["contacts_met"].plain == 1
    assert found["false_contacts"].plain == found["energy_score"].plain == 0


def test_excess_is_the_distance_to_other_people_less_that_of_the_real_pairs(sets, measured):
    real, train, rows = sets
    context = table_of(real, train).context
    row = rows["far"]
    to_others = {"far": [], "real": []}
    for first, second in context.halves:
        for one, other in ((first, second), (second, first)):
            i, j = (np.flatnonzero(counts[0, context.partners]) for counts in (one, other))
            assert not {real.units[k] for k in i} & {real.units[k] for k in j}
            for name, features in (("far", row.features), ("real", real.features)):
                to_others[name].append(f2id(features[i], real.features[j], WEIGHTS))
    assert len(to_others["far"]) == 2 * SETTINGS.second_samples
    expected = np.mean(to_others["far"]) - np.mean(to_others["real"])
    assert values(measured["far"])["f2id_excess"] == pytest.approx(expected)


def test_a_copy_of_training_motion_gains_nothing_in_excess(sets):
    real, train, _ = sets
    copied = replace(real, features=train.features[:32])
    others = replace(train, features=train.features + 5.0)
    found = [table_of(real, part).measure(copied) for part in (train, others)]
    assert values(found[0])["f2id_excess"] == values(found[1])["f2id_excess"]


def test_the_floor_is_the_distance_to_second_draws_of_training_motion(sets, measured):
    real, train, _ = sets
    seconds = table_of(real, train).context.second_sets
    assert [len(second) for second in seconds] == [32, 32]
    expected = np.mean([f2id(real.features, second.features, WEIGHTS) for second in seconds])
    assert values(measured["real"])["f2id"] == pytest.approx(expected)


def test_too_few_people_for_halves_have_no_excess(sets):
    real, train, rows = sets
    units = ["one", "two", "three"] * 8
    few = replace(real, units=[units[int(name[4:])] for name in real.clips])
    found = table_of(few, train).measure(rows["far"])
    assert "f2id_excess" not in found.estimates
    assert found.absent["f2id_excess"].startswith("fewer than four")
    for name, estimate in found.estimates.items():
        repeats = name.endswith("_published")
        assert len(estimate.resampled) == (3 if repeats else 0), name
        assert repeats or np.isnan(interval(estimate, 0.9).low)


def test_halves_of_four_units_have_a_value_and_no_replicates(sets):
    real, train, rows = sets
    few = replace(real, units=[f"unit{int(name[4:]) % 4}" for name in real.clips])
    found = table_of(few, train).measure(rows["far"]).estimates
    for name in ("f2id_excess", "f2id_distances"):
        assert found[name].plain > 0 and len(found[name].resampled) == 0
    assert len(found["f2id"].resampled) == 40


def test_halves_and_second_samples_share_what_is_drawn(sets):
    real, train, _ = sets
    context = table_of(real, train, replace(SETTINGS, second_samples=5, bootstrap=400)).context
    tested = context.groups == 0
    for first, second in context.halves:
        np.testing.assert_array_equal(first + second, context.counts * tested)
        assert (first.sum(axis=1) > 0).all() and (second.sum(axis=1) > 0).all()
    unit_of = dict(zip(train.clips, train.units, strict=True))
    columns = {}
    for number, second in enumerate(context.second_sets, start=1):
        for clip in {*second.clips}:
            (code,) = {*context.codes(second.take([second.clips.index(clip)]), number)}
            columns.setdefault(unit_of[clip], []).append(code)
    assert max(map(len, columns.values())) > 5
    for codes in columns.values():
        assert (np.ptp(context.counts[:, codes], axis=1) == 0).all()


def test_the_spread_of_a_mean_over_halves_is_that_of_the_plain_bootstrap():
    rng = np.random.default_rng(5)
    real, train = reactions(48, "test", rng), reactions(60, "train", rng)
    settings = replace(SETTINGS, second_samples=5, bootstrap=2000)
    context = EvaluationContext(real=real, train=train, weights=WEIGHTS, settings=settings)
    names, units = np.unique(real.units, return_inverse=True)
    of_clip = rng.normal(size=len(names))[units]  # a value of each unit of two clips

    def means(counts):
        weights = counts[1:, context.partners]
        return weights @ of_clip / weights.sum(axis=1)

    halves = np.mean([means(half) for pair in context.halves for half in pair], axis=0)
    # Five independent bootstraps would have 1/√5 = 0.45 of the spread.
    assert halves.std() == pytest.approx(
        means(context.counts * (context.groups == 0)).std(), rel=0.1
    )


def test_the_spread_of_a_mean_over_second_samples_is_that_of_one_if_all_are_the_same():
    rng = np.random.default_rng(6)
    real, train = reactions(40, "test", rng), reactions(41, "train", rng)
    settings = replace(SETTINGS, second_samples=5, bootstrap=1000)
    context = EvaluationContext(real=real, train=train, weights=WEIGHTS, settings=settings)
    value = dict(zip(train.clips, rng.normal(size=41).repeat(2), strict=True))
    spreads = []
    for number, second in enumerate(context.second_sets, start=1):
        weights = context.counts[1:, context.codes(second, number)]
        of_set = np.array([value[clip] for clip in second.clips])
        spreads.append(weights @ of_set / weights.sum(axis=1))
    assert np.mean(spreads, axis=0).std() == pytest.approx(np.std(spreads, axis=1).mean(), rel=0.1)


def test_the_energy_score_and_the_dispersion_are_those_of_the_samples(sets):
    real, train, _ = sets
    shifts = (1.0, 3.0, -1.0)  # metres along x, of three samples
    samples = [[m + np.float32([s, 0, 0]) for m in real.motions] for s in shifts]
    row = replace(
        real,
        motions=samples[0],
        further=np.zeros((2, *real.features.shape)),
        further_motions=samples[1:],
    )
    found = values(table_of(real, train).measure(row))
    # Distances to the truth 1, 3, 1; of pairs 2, 2, 4.
    assert found["energy_score"] == pytest.approx(5 / 3 - 8 / 3 / 2, abs=1e-6)
    assert found["dispersion"] == pytest.approx(8 / 5, abs=1e-6)
    point = values(table_of(real, train).measure(replace(real, motions=samples[1])))
    assert point["energy_score"] == pytest.approx(3, abs=1e-6)


def test_reactions_permuted_among_partners_are_still_the_same_motions(sets, measured):
    real, train, _ = sets
    chosen = permute_partners(real.clips, None, np.random.default_rng(0))
    permuted = real.take(chosen)
    on_time = [
        to_length(m, t, len(n)).astype(np.float32)
        for m, t, n in zip(permuted.motions, permuted.times, real.motions, strict=True)
    ]
    embedded = np.stack([real.embedded[0], permuted.embedded[1]])
    row = replace(
        permuted, motions=on_time, partners=real.partners, times=real.times, embedded=embedded
    )
    found = table_of(real, train).measure(row).estimates
    # Resampled to the partner's frames and then to the common ones, motions blur a little.
    assert abs(found["mmd_s"].plain) < 0.02
    pairs = measured["real_pairs"].estimates
    assert found["diversity"].plain == pytest.approx(pairs["diversity"].plain, rel=0.3)
    for name, good in (("ape", -1), ("matching", 1)):
        gap = interval(pairs[name].minus(found[name]), 0.9)
        assert good * gap.low > 0 and good * gap.high > 0, name


def test_a_paired_difference_tells_a_near_row_from_a_far_one(measured):
    near, far = (measured[row].estimates for row in ("near", "far"))
    for name in ("f2id", "f2id_excess", "f2id_infinity", "ape"):
        assert interval(far[name].minus(near[name]), 0.9).low > 0, name


def test_halves_of_the_real_motion_stand_higher_than_the_floor(measured):
    real = values(measured["real"])
    assert real["f2id_halves"] > real["f2id"]
    assert real["ape"] == real["ave_joints"] == 0


def test_one_random_seed_gives_one_table(sets):
    real, train, rows = sets
    settings = replace(SETTINGS, bootstrap=5)
    found = []
    for s in (settings, settings, replace(settings, random_seed=8)):
        table = table_of(real, train, s)
        far, floor = table.measure(rows["far"]), table.real(table.measure(real))
        found.append([values(far), values(floor), far.estimates["f2id"].resampled.tolist()])
    assert found[0] == found[1] != found[2]


def test_fewer_training_than_test_clips_give_one_second_draw_of_what_there_is(sets):
    real, train, rows = sets
    table = table_of(real, train.take(np.arange(20)))
    assert [len(second) for second in table.context.second_sets] == [20]
    far = table.measure(rows["far"]).estimates
    assert np.isfinite([estimate.plain for estimate in far.values()]).all()
    assert table.real(table.measure(real)).estimates["f2id"].plain > 0


def test_a_table_of_mistaken_rows_is_refused(sets):
    real, train, rows = sets
    table = table_of(real, train)
    with pytest.raises(ValueError, match="wanted 32 reactions"):
        table.measure(rows["far"].take(np.arange(5)))
    with pytest.raises(ValueError, match="clips must be"):
        table.measure(train.take(np.arange(32)))
    with pytest.raises(ValueError, match="share no clip"):
        table_of(real, real)


def test_a_contact_in_one_unit_alone_has_a_value_in_every_replicate(sets):
    real, train, _ = sets
    apart = [m + np.float32(9) for m in real.motions]
    apart[:4] = real.partners[:4]  # the first unit of four touches
    rare = replace(real, motions=apart)
    found = table_of(rare, train).measure(rare).estimates
    assert found["contacts_met"].plain == 1 and (found["contacts_met"].resampled == 1).all()
    far = replace(real, motions=[m + np.float32(9) for m in real.motions])
    missing = table_of(far, train).measure(far)
    assert "contacts_met" not in missing.estimates
    assert missing.absent["contacts_met"] == "no frame with contact"
