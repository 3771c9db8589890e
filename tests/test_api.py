"""What is trusted: the functions of the packages that the public interface calls."""

import subprocess
import sys

import numpy as np
import pytest
from torch import nn

import pacmo_core
from pacmo_core import interaction_mesh, reaction, skeleton_prior
from pacmo_core.data.interaction import Interaction, bone_lengths
from pacmo_core.formats.write_bvh import format_bvh
from pacmo_core.formats.write_ntu import format_ntu
from pacmo_core.models import load_reaction_model
from pacmo_core.reaction.inference import PACKAGED

SMALL = {"n_epochs": 2, "width": 8, "n_points": 17, "modes": [8, 6, 4, 4, 4, 6, 8]}


@pytest.fixture(scope="module")
def clips():
    return list(pacmo_core.synthesise(12).values())


@pytest.fixture(scope="module")
def regression(clips):
    return pacmo_core.train("regression", clips, **SMALL)


def test_importing_the_package_imports_nothing_heavy():
    code = "import pacmo_core.reaction, pacmo_core.skeleton_prior, sys; print(*sys.modules)"
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not {"torch", "numpy", "scipy", "polars", "dvc"} & set(ended.stdout.split())


@pytest.mark.parametrize("package", [pacmo_core, interaction_mesh, reaction, skeleton_prior])
def test_every_name_of_the_public_interface_is_there(package):
    assert all(getattr(package, name) is not None for name in package.__all__)
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = package.nothing


def test_a_reaction_keeps_the_partner_and_has_the_frames_of_the_clip(clips, regression):
    (reaction,) = pacmo_core.react(regression, clips[0], person="b")
    np.testing.assert_array_equal(reaction.person_a, clips[0].person_b)
    assert reaction.person_b.shape == clips[0].person_a.shape


def test_a_saved_model_gives_the_same_reaction_and_clips_may_have_names(
    clips, regression, tmp_path
):
    path = pacmo_core.save("regression", regression, tmp_path / "weights.safetensors")
    (expected,), (reaction,) = (pacmo_core.react(model, clips[0]) for model in (regression, path))
    np.testing.assert_array_equal(reaction.person_b, expected.person_b)
    named = {str(number): clip for number, clip in enumerate(clips)}
    again = pacmo_core.train("regression", named, **SMALL)
    np.testing.assert_array_equal(pacmo_core.react(again, clips[0])[0].person_b, expected.person_b)


def test_a_generative_model_samples_reactions_that_differ_and_repeat_with_the_seed(clips):
    model = pacmo_core.train("pacmo", clips, **SMALL)
    first, second = pacmo_core.react(model, clips[0], n_samples=2)
    assert np.abs(first.person_b - second.person_b).max() > 0
    again, _ = pacmo_core.react(model, clips[0], n_samples=2)
    np.testing.assert_array_equal(first.person_b, again.person_b)


def test_the_weights_in_the_package_react_to_clips_of_other_joints():
    (clip,) = pacmo_core.synthesise(1).values()
    (reaction,) = pacmo_core.react(None, clip, person="b")
    model = load_reaction_model(PACKAGED)
    assert reaction.skeleton == model.skeleton != clip.skeleton
    # The model's joints are some of the clip's.
    kept = clip.skeleton.indices(model.skeleton.joints)
    np.testing.assert_array_equal(reaction.person_a, clip.person_b[:, kept])


def test_a_person_is_loaded_from_a_bvh_file_and_reacted_to(tmp_path):
    (clip,) = pacmo_core.synthesise(1).values()
    file = tmp_path / "walk.bvh"
    file.write_text(format_bvh(100 * clip.person_a, clip.fps, clip.skeleton))  # in centimetres
    loaded = pacmo_core.load_person(file)
    np.testing.assert_allclose(loaded.motion[:, 0], clip.person_a[:, 0], atol=1e-3)
    (reaction,) = pacmo_core.react(None, loaded)
    assert reaction.person_b.shape[0] == len(clip.times)
    stated = pacmo_core.load_person(file, unit=0.011, up="y")
    np.testing.assert_allclose(stated.motion, 1.1 * loaded.motion, rtol=1e-5)
    for wrong, error, words in (
        ({"unit": 0.1, "up": "y"}, ValueError, "walk.bvh: .*wrong unit or up"),
        ({"unit": "yd", "up": "y"}, ValueError, "unit must be metres or m, cm, .*; got 'yd'"),
        ({"unit": None, "up": "y"}, TypeError, "unit must be int or float; got NoneType"),
        ({"unit": 0.01, "up": "z"}, ValueError, "walk.bvh: .*wrong unit or up"),
        ({"person": "b"}, ValueError, "holds one person: person must be None; got 'b'"),
    ):
        with pytest.raises(error, match=words):
            pacmo_core.load_person(file, **wrong)


def test_a_temperature_of_0_gives_one_reaction_and_leaves_the_model_as_it_was(clips):
    model = pacmo_core.train("pacmo", clips, **SMALL)
    before = pacmo_core.react(model, clips[0])[0].person_b
    first, second = (
        pacmo_core.react(model, clips[0], random_seed=seed, temperature=0)[0].person_b
        for seed in (1, 2)
    )
    np.testing.assert_array_equal(first, second)
    for wrong in ({"n_samples": 2}, {"touch": "hands"}):
        with pytest.raises(ValueError, match="temperature 0, has one reaction"):
            pacmo_core.react(model, clips[0], temperature=0, **wrong)
    np.testing.assert_array_equal(pacmo_core.react(model, clips[0])[0].person_b, before)
    with pytest.raises(ValueError, match="action must be empty"):
        pacmo_core.react(model, clips[0], action="hug", temperature=0.5)
    np.testing.assert_array_equal(pacmo_core.react(model, clips[0])[0].person_b, before)


def test_a_model_of_labels_is_selected_on_labelled_clips(clips):
    labels = ["push", "kick"] * (len(clips) // 2)
    model = pacmo_core.train(
        "pacmo",
        clips[: len(labels)],
        validation=clips[:2],
        actions=labels,
        validation_actions=labels[:2],
        action_channels=2,
        **SMALL,
    )
    (reaction,) = pacmo_core.react(model, clips[0], action="push")
    assert np.isfinite(reaction.person_b).all()


def test_reactions_that_touch_as_asked_are_those_of_the_seed():
    clip = pacmo_core.synthesise(10)["handshake-1"]
    every = pacmo_core.react(None, clip, n_samples=6, temperature=2)
    hand = clip.skeleton.joints.index("right_hand")
    gaps = [np.linalg.norm((one.person_a - one.person_b)[:, hand], axis=-1).min() for one in every]
    near = [one.person_b for one, gap in zip(every, gaps, strict=True) if gap < 0.1]
    assert 0 < len(near) < 6
    kept = pacmo_core.react(None, clip, n_samples=len(near), temperature=2, touch="right-hands")
    np.testing.assert_allclose([one.person_b for one in kept], near, atol=1e-3)


def test_a_capture_of_two_people_is_refused_in_the_words_of_python(clips, tmp_path):
    clip, file = clips[0], tmp_path / "two.skeleton"
    file.write_bytes(format_ntu(clip, (1, 2)))
    with pytest.raises(ValueError, match=r"holds two people: wanted one \(person=\), a or b"):
        pacmo_core.load_person(file)


def test_a_model_without_noise_has_no_temperature(clips, regression):
    with pytest.raises(ValueError, match="the model has no noise"):
        pacmo_core.react(regression, clips[0], temperature=0.5)
    with pytest.raises(ValueError, match="n_samples must be 1 and touch empty; got 1 and 'body'"):
        pacmo_core.react(regression, clips[0], touch="body")


def test_the_seed_changes_the_weights_of_every_model(clips):
    small = {"n_epochs": 1, "width": 8}
    first, second = (
        pacmo_core.train("autoencoder", clips, random_seed=seed, **small) for seed in (1, 2)
    )
    pairs = zip(first.parameters(), second.parameters(), strict=True)
    assert any((a != b).any() for a, b in pairs)


def test_a_model_is_not_saved_under_another_name(regression, tmp_path):
    with pytest.raises(ValueError, match="a trained gru; got Generator"):
        pacmo_core.save("gru", regression, tmp_path / "weights.safetensors")
    assert not list(tmp_path.iterdir())


def test_retargeting_scales_the_bones_of_one_person_and_keeps_the_others(clips):
    clip = clips[2]
    child = pacmo_core.retarget(clip, b={"uniform": 0.8})
    before, after = (bone_lengths(c.person_b, c.skeleton) for c in (clip, child))
    np.testing.assert_allclose(after.mean(axis=0), 0.8 * before.mean(axis=0), rtol=0.02)
    kept = bone_lengths(clip.person_a, clip.skeleton).mean(axis=0)
    np.testing.assert_allclose(
        bone_lengths(child.person_a, clip.skeleton).mean(axis=0), kept, rtol=0.02
    )


def test_real_reactions_are_perfect_and_others_are_not(clips, regression):
    extractor = pacmo_core.train("autoencoder", clips, n_epochs=2, width=8)
    same = pacmo_core.evaluate(clips, clips, extractor=extractor)
    assert same["f2id"] == pytest.approx(0, abs=1e-9) and same["ape"] == 0
    reactions = [pacmo_core.react(regression, clip)[0] for clip in clips]
    other = pacmo_core.evaluate(clips, reactions, extractor=extractor)
    assert other["f2id"] > 0.01 and other["ape"] > 0.01


def test_captures_of_other_joints_are_compared_on_those_of_the_reactions(clips):
    captured = clips[:4]
    package = [pacmo_core.react(None, clip)[0] for clip in captured]
    assert package[0].skeleton != captured[0].skeleton
    scores = pacmo_core.evaluate(captured, package, n_epochs=1)
    assert scores["ape"] > 0 and all(np.isfinite(list(scores.values())))
    shown = package[0].skeleton
    rows = captured[0].skeleton.indices(shown.joints)
    known = [
        Interaction(shown, clip.times, clip.person_a[:, rows], clip.person_b[:, rows])
        for clip in captured
    ]
    assert pacmo_core.evaluate(known, package, n_epochs=1) == pytest.approx(scores, rel=1e-3)


def test_defaults_are_those_of_params_yaml():
    settings = pacmo_core.default_settings("train_gru")
    assert settings["hidden"] == 200
    settings["hidden"] = 1
    assert pacmo_core.default_settings("train_gru")["hidden"] == 200


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        (lambda c: pacmo_core.train("x", c), ValueError, "name must be one of pacmo, .* got 'x'"),
        (lambda c: pacmo_core.train("gru", c, n_epoch=3), ValueError, "wanted .*; got n_epoch"),
        (lambda c: pacmo_core.train("gru", c, n_epochs="a"), ValueError, "n_epochs: .* got 'a'"),
        (lambda c: pacmo_core.train("gru", [1]), TypeError, r"clips\[0\] must be Interaction"),
        (lambda c: pacmo_core.react("none", 3), TypeError, "partner must be Inter.*; got int"),
        (lambda c: pacmo_core.retarget(c[0]), ValueError, "a and b must not both be None"),
        (lambda c: pacmo_core.retarget(c[0], a={}), ValueError, "one body must change"),
        (
            lambda c: pacmo_core.retarget(c[0], a=[1]),
            TypeError,
            "a must be str or Mapping; got list",
        ),
        (lambda c: pacmo_core.retarget(c[0], a={"uniform": "x"}), TypeError, "uniform must be int"),
        (lambda c: pacmo_core.retarget(c[0], a={"uniform": -1}), ValueError, "scale of uniform"),
        (lambda c: pacmo_core.react(3, c[0]), TypeError, "model must generate reactions; got int"),
        (
            lambda c: pacmo_core.react(3, c[0], random_seed="x"),
            TypeError,
            "random_seed must be int",
        ),
        (lambda c: pacmo_core.train("gru", c, device="gpu"), ValueError, "device must be .*'gpu'"),
        (lambda c: pacmo_core.train("gru", c, actions=["x"]), ValueError, "actions must be empty"),
        (
            lambda c: pacmo_core.train("pacmo", c, validation=c, actions=["x"] * len(c)),
            ValueError,
            "validation_actions must be one for each clip, .*; got none",
        ),
        (lambda c: pacmo_core.synthesise(1, random_seed=-1), ValueError, "random_seed must not"),
        (lambda c: pacmo_core.default_settings("experiment"), ValueError, "section must be one of"),
        (
            lambda c: pacmo_core.save("gru", nn.Linear(1, 1), "x"),
            ValueError,
            "a trained gru; got L",
        ),
        (lambda c: pacmo_core.evaluate(c, c, extractor=1), TypeError, "extractor must be Auto"),
        (
            lambda c: pacmo_core.evaluate({"x": c[0], "y": c[1]}, {"x": c[0], "z": c[1]}),
            ValueError,
            "generated must have the clips of real; differs in 'y'",
        ),
        (
            lambda c: pacmo_core.train("gru", c, validation=[c[0].without(["head"])]),
            ValueError,
            "validation must be of one skeleton",
        ),
        (lambda c: pacmo_core.view({1: c[0]}, "x.html"), TypeError, "label must be str; got int"),
        (lambda c: pacmo_core.retarget(c[0], a="giant"), ValueError, "a: .*giant"),
        (lambda c: pacmo_core.evaluate(c, c[:3]), ValueError, "generated must have 12 clips"),
        (lambda c: pacmo_core.view({}, "v.html"), ValueError, "clips must be 1 to 6; got 0"),
        (lambda c: pacmo_core.load_clips("none"), ValueError, "folder must be an existing folder"),
        (lambda c: pacmo_core.load_clips(".", "fbx"), ValueError, "format must be one of ntu"),
        (lambda c: pacmo_core.load_clips(".", "bvh"), ValueError, "preset pair states no unit"),
        (lambda c: pacmo_core.load_clips(".", "bvh", fbs=3), ValueError, "no setting fbs"),
        (lambda c: pacmo_core.load_person("x.bvh"), ValueError, "x.bvh: cannot be read"),
        (lambda c: pacmo_core.load_person("x.fbx"), ValueError, "belongs to no format"),
        (
            lambda c: pacmo_core.react(None, c[0], touch="feet"),
            ValueError,
            "touch must be one of right-hands, left-hands, hands, embrace, body, by-partner, no",
        ),
        (
            lambda c: pacmo_core.react(None, c[0], temperature=-1),
            ValueError,
            "temperature must be 0 to 2; got -1",
        ),
        (lambda c: pacmo_core.synthesise(0), ValueError, "n must be at least 1; got 0"),
    ],
)
def test_a_wrong_argument_is_refused_in_one_line_by_its_name(clips, call, error, words):
    with pytest.raises(error, match=words) as caught:
        call(clips)
    assert "\n" not in str(caught.value)
