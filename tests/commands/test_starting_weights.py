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
    PACKAGED,
    TRAINED_HERE,
    default_weights,
    package_weights,
)
from pacmo_core.data.interaction import bone_lengths
from pacmo_core.models import load_reaction_model
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
