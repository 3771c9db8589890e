"""The registry of models: every row can be imported, trained and read."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from ruamel.yaml import YAML

from pacmo_core.models import MODELS, get_model, load_model, model_names
from pacmo_core.store.files import StoreError
from pacmo_core.store.weights import write_weights
from pacmo_core.training.loop import TrainingData, TrainingLoop
from pacmo_core.training.state import model_config, model_state
from tests.reaction.problems import AUTOENCODER, FLOW_MATCHING, GRU, PACMO, REGRESSION, clips
from tests.reaction.test_matcher import SETTINGS as MATCHER

ROOT = Path(__file__).parents[1]
SETTINGS: dict[str, Any] = {
    "pacmo": PACMO,
    "pacmo_paper": replace(PACMO, action_channels=2),
    "regression": replace(REGRESSION, n_epochs=2),
    "gru": replace(GRU, n_epochs=2),
    "flow_matching": replace(FLOW_MATCHING, n_epochs=2),
    "autoencoder": replace(AUTOENCODER, n_epochs=2),
    "matcher": replace(MATCHER, n_epochs=2),
}


def loop(name: str) -> TrainingLoop[torch.nn.Module]:
    data = TrainingData(clips(8), train_actions=["push", "hug"] * 4)
    return MODELS[name].build_training(data, SETTINGS[name])


def test_importing_the_registry_does_not_import_torch() -> None:
    program = "import sys, pacmo_core.models; sys.exit('torch' in sys.modules)"
    subprocess.run([sys.executable, "-c", program], check=True, cwd=ROOT)


@pytest.mark.parametrize("name", MODELS)
def test_every_model_has_a_section_of_params_and_settings_to_read_it(name: str) -> None:
    sections = YAML(typ="safe").load(ROOT / "params.yaml")
    model = MODELS[name]
    keys = model.settings_class().__dataclass_fields__.keys()
    assert set(sections[model.section]) <= keys | {"threads"}
    assert model.package in {"reaction", "skeleton_prior"}


@pytest.mark.parametrize("name", SETTINGS)
def test_one_seed_gives_one_model_bit_for_bit(name: str) -> None:
    first, second = (model_state(loop(name).finish()) for _ in range(2))
    assert all(torch.equal(first[key], second[key]) for key in first)


@pytest.mark.parametrize("name", SETTINGS)
def test_a_model_is_read_from_its_weights_and_configuration(name: str, tmp_path: Path) -> None:
    model = loop(name).finish()
    config = json.loads(json.dumps(model_config(model)))
    path = tmp_path / "weights.safetensors"
    write_weights(path, {"model": name, "config": config}, model_state(model))
    again = load_model(path, MODELS[name].kind)
    assert again.config == model.config
    assert all(torch.equal(a, model_state(again)[key]) for key, a in model_state(model).items())


def test_weights_of_another_kind_and_unknown_models_are_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "weights.safetensors"
    write_weights(path, {"model": "gru", "config": {}}, {"weight": torch.zeros(1)})
    with pytest.raises(StoreError, match="autoencoder, matcher; got gru"):
        load_model(path, "features")
    with pytest.raises(StoreError, match="another version"):
        load_model(path, "reaction")
    with pytest.raises(ValueError, match="kinematic, .*m_gcn; got 'mlp'"):
        get_model("mlp", "skeleton_prior")
    assert model_names("features") == ("autoencoder", "matcher")
