"""Oracle: bone lengths, single retargets, and the same scene elsewhere in the world."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.interpolate import CubicSpline

from pacmo_core.data.interaction import bone_lengths
from pacmo_core.models import model_names
from pacmo_core.skeleton_prior import training
from pacmo_core.skeleton_prior.data import interpolate_keyframes, keyframe_indices
from pacmo_core.skeleton_prior.inference import generate_skeletons, retarget
from tests.skeleton_prior.examples import SMALL, examples, generator, interaction, settings

MODELS = {
    name: training.build_training(examples(), settings(model=name, n_epochs=1)).finish()
    for name in model_names("skeleton_prior")
}


def bodies(*scales: float):
    """List bodies with one bone of person b changed, then one of person a."""
    result = np.ones((2 * len(scales), 2, len(SMALL.bones)))
    for row, scale in enumerate(scales):
        result[2 * row, 1, row] = result[2 * row + 1, 0, row] = scale
    return result


def test_bone_lengths_are_exact_outside_the_training_range_too():
    source, scales_of_bodies = interaction(1), bodies(0.65, 0.75, 1.25, 1.3)
    scales_of_bodies = np.concatenate(
        [scales_of_bodies, scales_of_bodies[:1] * scales_of_bodies[5:6]]
    )  # and one in which both change
    for scales, samples in zip(
        scales_of_bodies,
        retarget(MODELS["kinematic"], source, scales_of_bodies, samples=3, random=generator()),
        strict=True,
    ):
        assert len(samples) == 3
        for pair in samples:
            for name, own in zip(("person_a", "person_b"), scales, strict=True):
                expected = own * bone_lengths(getattr(source, name), SMALL)
                np.testing.assert_allclose(
                    bone_lengths(getattr(pair, name), SMALL), expected, atol=3e-6
                )


@pytest.mark.parametrize("name", model_names("skeleton_prior"))
def test_a_result_does_not_depend_on_its_batch(name):
    source, scales_of_bodies = interaction(1), bodies(0.75, 1.2)
    together = list(retarget(MODELS[name], source, scales_of_bodies, samples=1, random=None))
    for row, (pair,) in enumerate(together):
        ((alone,),) = retarget(
            MODELS[name], source, scales_of_bodies[[row]], samples=1, random=None
        )
        np.testing.assert_allclose(alone.person_a, pair.person_a, atol=1e-5)
        np.testing.assert_allclose(alone.person_b, pair.person_b, atol=1e-5)


def test_samples_differ_by_their_latents_only():
    source, scales_of_bodies = interaction(1), bodies(0.8)
    model = MODELS["paper"]
    ((one, other), _) = retarget(model, source, scales_of_bodies, samples=2, random=generator())
    assert not np.array_equal(one.person_b, other.person_b)
    ((again, _), _) = retarget(model, source, scales_of_bodies, samples=2, random=generator())
    np.testing.assert_array_equal(one.person_b, again.person_b)
    ((plain, twin), _) = retarget(model, source, scales_of_bodies, samples=2, random=None)
    np.testing.assert_array_equal(plain.person_a, twin.person_a)


def test_samples_are_the_more_alike_the_lower_the_temperature():
    source, scales = interaction(1), bodies(0.8)
    found = []
    for temperature in (0.0, 0.5, 1.0):
        drawn = retarget(MODELS["paper"], source, scales, samples=6, random=generator(),
                         temperature=temperature)  # fmt: skip
        several = [np.stack([one.person_a, one.person_b]) for body in drawn for one in body]
        found.append(np.std(several[:6], axis=0).mean())
    assert found[0] < 1e-6 < 0.3 * found[2] < found[1] < 0.7 * found[2]
    with pytest.raises(ValueError, match="temperature must be 0 to 2; got 3"):
        next(retarget(MODELS["kinematic"], source, scales, samples=1, random=None, temperature=3))


def test_samples_may_exceed_the_batch_size():
    source, scales_of_bodies = interaction(1, n_frames=4), bodies(0.8)
    many = list(retarget(MODELS["kinematic"], source, scales_of_bodies, samples=35, random=None))
    one = list(retarget(MODELS["kinematic"], source, scales_of_bodies, samples=1, random=None))
    assert [len(samples) for samples in many] == [35, 35]
    for samples, (alone,) in zip(many, one, strict=True):
        for pair in samples:
            np.testing.assert_allclose(pair.person_b, alone.person_b, atol=1e-5)


@pytest.mark.parametrize("times", [2, 4])
def test_the_result_does_not_depend_on_the_frame_rate(times):
    source, scales_of_bodies = interaction(1), bodies(0.8)
    instants = np.linspace(source.times[0], source.times[-1], times * len(source.times) - times + 1)
    denser = replace(
        source,
        times=instants,
        person_a=CubicSpline(source.times, source.person_a)(instants).astype(np.float32),
        person_b=CubicSpline(source.times, source.person_b)(instants).astype(np.float32),
    )
    result, dense = (
        list(retarget(MODELS["kinematic"], pair, scales_of_bodies, samples=1, random=None))
        for pair in (source, denser)
    )
    for (one,), (other,) in zip(result, dense, strict=True):
        # Heights too follow the ground, which differs a little. At the wrong rate positions
        # differ by 0.08 mm or more.
        for got, expected in ((other.person_a, one.person_a), (other.person_b, one.person_b)):
            assert np.abs(got[::times] - expected)[..., [0, 2]].mean() < 5e-5


def test_retargeting_commutes_with_rigid_motion():
    source, scales_of_bodies = interaction(1), bodies(0.8)
    turn = np.array([[0, 0, 1], [0, 1, 0], [-1, 0, 0]], dtype=np.float32)

    def moved(motion):
        return (motion @ turn.T + np.array([3, 0.5, -2])).astype(np.float32)

    elsewhere = replace(source, person_a=moved(source.person_a), person_b=moved(source.person_b))
    model = MODELS["kinematic"]
    ((pair,), _) = retarget(model, source, scales_of_bodies, samples=1, random=None)
    ((far,), _) = retarget(model, elsewhere, scales_of_bodies, samples=1, random=None)
    np.testing.assert_allclose(far.person_b, moved(pair.person_b), atol=1e-3)


def test_scales_of_one_reproduce_the_source_to_a_millimetre():
    source = interaction(1)
    same = np.ones((1, 2, len(SMALL.bones)))
    ((pair,),) = retarget(MODELS["kinematic"], source, same, samples=1, random=None)
    assert np.abs(pair.person_a - source.person_a).max() < 1e-3
    assert np.abs(pair.person_b - source.person_b).max() < 1e-3
    assert pair.times is source.times


def test_generated_skeletons_have_positive_scales_of_one_person():
    drawn = generate_skeletons(MODELS["kinematic"], 500, random=generator())
    assert drawn.shape == (500, 2, len(SMALL.bones))
    assert (drawn[:, 0] == 1).all() and (drawn >= 0.7).all() and (drawn <= 1.3).all()
    np.testing.assert_array_equal(
        drawn, generate_skeletons(MODELS["kinematic"], 500, random=generator())
    )
    batch = list(retarget(MODELS["f_cnn"], interaction(), drawn[:3], samples=2, random=generator()))
    assert [len(samples) for samples in batch] == [2, 2, 2]


@pytest.mark.parametrize(
    ("n_frames", "stride"), [(2, 3), (3, 2), (31, 3), (32, 3), (33, 3), (9, 1)]
)
def test_keyframes_include_both_ends_and_interpolate_by_a_spline(n_frames, stride):
    keys = keyframe_indices(n_frames, stride)
    assert keys[0] == 0 and keys[-1] == n_frames - 1
    assert (np.diff(keys) > 0).all() and np.diff(keys).max() <= stride
    field = torch.randn(2, len(keys), 4, 3, generator=generator())
    got = interpolate_keyframes(field, n_frames, stride)
    expected = CubicSpline(keys, field.double().numpy(), axis=1)(np.arange(n_frames))
    np.testing.assert_allclose(got.numpy(), expected, atol=1e-5)


def test_errors_name_the_expected_value():
    model, source = MODELS["kinematic"], interaction()
    good = bodies(0.8)

    def run(scales=good, samples=1, pair=source):
        return list(retarget(model, pair, scales, samples=samples, random=None))

    bad = good.copy()
    bad[1, 0, 4] = np.nan
    with pytest.raises(ValueError, match="positive and finite; row 1, person a, bone 4 is nan"):
        run(bad)
    with pytest.raises(ValueError, match=r"scales must be \(V, 2, 13\); got \(2, 2, 4\)"):
        run(good[..., :4])
    with pytest.raises(ValueError, match="samples must be at least 1; got 0"):
        run(samples=0)
    with pytest.raises(
        ValueError, match="model's skeleton is small of 14 joints; got small-12 of 12"
    ):
        run(pair=source.without(["left_wrist", "right_wrist"]))
