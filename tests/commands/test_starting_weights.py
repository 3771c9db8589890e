"""The weights in the package. Truth: their card, a capture of the embedded default, and a copy."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from pacmo_core import api
from pacmo_core.commands.cli import app
from pacmo_core.commands.weights import (
    CARD,
    MAX_BYTES,
    MAX_PRIOR_BYTES,
    PACKAGED,
    PACKAGED_PRIOR,
    PRIOR_TRAINED_HERE,
    TRAINED_HERE,
    default_prior,
    default_weights,
    package_prior,
    package_weights,
)
from pacmo_core.data.interaction import bone_lengths
from pacmo_core.models import load_reaction_model, load_skeleton_prior
from pacmo_core.project.workspace import CommandError
from pacmo_core.store.files import file_hash
from pacmo_core.store.motions import stream_motions, write_motions
from pacmo_core.store.weights import read_trained_on


def test_the_weights_match_their_card_and_fit_into_the_package() -> None:
    card, model = json.loads(CARD.read_text("utf-8")), load_reaction_model(PACKAGED)
    assert card["sha256"] == file_hash(PACKAGED)
    assert card["joints"] == list(model.skeleton.joints)
    trained_on = read_trained_on(PACKAGED)
    assert trained_on is not None and trained_on.is_synthetic
    assert card["trained_on"] == json.loads(json.dumps(trained_on.to_dict()))
    assert card["licence"] == "Apache-2.0" and card["limits"]
    assert 0 < card["scores"][card["model"]]["contacts_met"] <= 1
    assert PACKAGED.stat().st_size <= MAX_BYTES


def test_a_capture_is_answered_where_there_is_no_checkout(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (clip,) = api.synthesise(1).values()
    joints = load_reaction_model(PACKAGED).skeleton.joints
    clip = clip.without([name for name in clip.skeleton.joints if name not in joints])
    with write_motions(tmp_path / "clip.parquet", clip.skeleton) as writer:
        writer.add("one", clip)
    words = ["react", "clip.parquet", "--clip", "one", "--person", "a", "--out", "out.parquet"]
    said = CliRunner().invoke(app, [*words, "--samples", "2"])
    assert said.exit_code == 0, said.output
    assert "the model in the package was trained on" in said.output
    assert "all synthetic" in said.output
    reactions = [pair for _, pair in stream_motions(tmp_path / "out.parquet")]
    assert len(reactions) == 2
    for pair in reactions:
        assert pair.person_b.shape == clip.person_a.shape
        lengths = bone_lengths(pair.person_b, pair.skeleton)
        np.testing.assert_allclose(lengths, lengths[:1].repeat(len(lengths), axis=0), rtol=1e-3)


def test_weights_that_were_trained_here_come_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert default_weights() == PACKAGED
    TRAINED_HERE.parent.mkdir(parents=True)
    TRAINED_HERE.touch()
    assert default_weights() == TRAINED_HERE


def test_a_copy_of_a_run_has_its_weights_and_its_scores(tmp_path: Path) -> None:
    model, metrics = tmp_path / "model", tmp_path / "metrics.json"
    model.mkdir()
    (model / "weights.safetensors").write_bytes(PACKAGED.read_bytes())
    metrics.write_text(json.dumps({"pacmo": {"pacmo": {"ape": 0.5}, "gru": {"ape": 1.0}}}))
    target = tmp_path / "copy.safetensors"
    package_weights(model, metrics, target)
    assert target.read_bytes() == PACKAGED.read_bytes()
    card = json.loads((tmp_path / "copy.json").read_text())
    assert card["sha256"] == file_hash(PACKAGED)
    assert card["scores"] == {"pacmo": {"ape": 0.5}}
    metrics.write_text(json.dumps({"pacmo": {"gru": {"ape": 1.0}}}))
    with pytest.raises(CommandError, match="wanted scores of pacmo; got those of gru"):
        package_weights(model, metrics, target)


def test_the_prior_matches_its_card_which_has_its_evaluation() -> None:
    card = json.loads(PACKAGED_PRIOR.with_suffix(".json").read_text("utf-8"))
    prior = load_skeleton_prior(PACKAGED_PRIOR)
    assert card["sha256"] == file_hash(PACKAGED_PRIOR)
    assert card["joints"] == list(prior.config.skeleton.joints)
    assert card["gain"]["default"]["random"]["weights"] == [card["sha256"]]
    trained_on = read_trained_on(PACKAGED_PRIOR)
    assert trained_on is not None and trained_on.is_synthetic
    assert PACKAGED_PRIOR.stat().st_size <= MAX_PRIOR_BYTES


def test_bodies_are_varied_where_there_is_no_checkout(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (clip,) = api.synthesise(1).values()
    joints = load_skeleton_prior(PACKAGED_PRIOR).config.skeleton.joints
    clip = clip.without([name for name in clip.skeleton.joints if name not in joints])
    with write_motions(tmp_path / "clip.parquet", clip.skeleton) as writer:
        writer.add("one", clip)
    words = ["vary", "clip.parquet", "--clip", "one", "--samples", "2", "--out", "out.parquet"]
    said = CliRunner().invoke(app, words)
    assert said.exit_code == 0, said.output
    assert "the model in the package was trained on" in said.output
    assert "the start alone, a rule without training, is used: the network is" in said.output
    first, second = (pair for _, pair in stream_motions(tmp_path / "out.parquet"))
    lengths = [bone_lengths(pair.person_b, pair.skeleton)[0] for pair in (first, second)]
    assert abs(lengths[0] - lengths[1]).max() > 1e-3, "each sample is another body"


def test_a_prior_that_a_run_has_trained_comes_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pacmo_core.commands.weights.in_project", lambda path: tmp_path / path)
    assert default_prior() == PACKAGED_PRIOR
    (tmp_path / PRIOR_TRAINED_HERE).parent.mkdir(parents=True)
    (tmp_path / PRIOR_TRAINED_HERE).write_bytes(b"x")
    assert default_prior() == tmp_path / PRIOR_TRAINED_HERE


def test_a_prior_is_packaged_with_the_evaluation_of_its_own_weights(tmp_path: Path) -> None:
    (tmp_path / "weights.safetensors").write_bytes(PACKAGED_PRIOR.read_bytes())
    card = json.loads(PACKAGED_PRIOR.with_suffix(".json").read_text("utf-8"))
    gains = {**card["gain"], "other": {"random": {"weights": ["0" * 64]}}}
    (tmp_path / "evaluation.json").write_text(json.dumps({"gain": gains}))
    target = tmp_path / "copy.safetensors"
    package_prior(tmp_path, tmp_path / "evaluation.json", target)
    assert file_hash(target) == card["sha256"]
    assert json.loads(target.with_suffix(".json").read_text("utf-8")) == card
    (tmp_path / "evaluation.json").write_text(json.dumps({"gain": {"other": gains["other"]}}))
    with pytest.raises(CommandError, match="wanted the evaluation of"):
        package_prior(tmp_path, tmp_path / "evaluation.json", target)
