"""Truth: weights of a small trained model; the files are altered as others might write them."""

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from safetensors.torch import save_file

from pacmo_core.api import save, synthesise, train
from pacmo_core.models import load_reaction_model
from pacmo_core.store.files import StoreError
from pacmo_core.store.weights import read_weights

State = dict[str, torch.Tensor]
Alter = Callable[[dict[str, Any], State], Any]


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    model = train("pacmo", synthesise(4), n_epochs=1, width=4)
    return save("pacmo", model, tmp_path_factory.mktemp("model") / "w.safetensors")


def altered(source: Path, target: Path, alter: Alter) -> Path:
    config, state = read_weights(source)
    facts = alter(config, state)
    save_file(state, target, metadata={"config": json.dumps(facts)})
    return target


def setting(*keys: str, value: object) -> Alter:
    def alter(config: dict[str, Any], _: State) -> dict[str, Any]:
        place = config
        for key in keys[:-1]:
            place = place[key]
        place[keys[-1]] = value
        return config

    return alter


def tensor(change: Callable[[State, str], object]) -> Alter:
    def alter(config: dict[str, Any], state: State) -> dict[str, Any]:
        change(state, min(name for name in state if state[name].ndim > 1))
        return config

    return alter


FAULTS: dict[str, Alter] = {
    "its configuration is a list": lambda *_: [],
    "its configuration is a NoneType": lambda *_: None,
    "its configuration is a float": lambda *_: float("nan"),
    "got None": lambda config, _: {"config": config["config"]},
    r"got \['pacmo'\]": setting("model", value=["pacmo"]),
    "differs in": setting("config", value=None),
    "Missing key": tensor(lambda state, name: state.pop(name)),
    "Unexpected key": tensor(lambda state, _: state.update(more=torch.zeros(1))),
    "size mismatch": tensor(lambda state, name: state.update({name: state[name][:-1].clone()})),
    "wanted finite numbers": tensor(
        lambda state, name: state.update({name: state[name] * float("nan")})
    ),
    "wanted torch.float32, got torch.int32": tensor(
        lambda state, name: state.update({name: state[name].int()})
    ),
    "period must exceed 1": setting("config", "uno", "period", value=1e-9),
    "grids of at most 4096 points": setting("config", "uno", "n_points", value=10**6 + 1),
    "100000000 parameters": setting("config", "uno", "lifting", value=10**6),
    "cannot convert float NaN": setting("config", "uno", "period", value=float("nan")),
    "names as text": setting("config", "skeleton", "joints", value=[1, 2]),
    "boolean": setting("config", "uno", "skips", value=1),
    "action_channels must be positive": setting("config", "actions", value=["a"]),
    "channels and modes must be at least 1": setting("config", "uno", "lifting", value=0),
    "input channels": setting("config", "noise_channels", value=-1),
    "n_frequencies must be": setting("config", "noise", "n_frequencies", value=10**9),
}


@pytest.mark.parametrize("reason", FAULTS)
def test_weights_that_are_not_a_models_are_refused(
    source: Path, tmp_path: Path, reason: str
) -> None:
    path = altered(source, tmp_path / "w.safetensors", FAULTS[reason])
    with pytest.raises(StoreError, match=f"w.safetensors: .*{reason}") as caught:
        load_reaction_model(path)
    assert "\n" not in str(caught.value)


def test_unaltered_weights_are_read(source: Path, tmp_path: Path) -> None:
    path = altered(source, tmp_path / "w.safetensors", lambda config, _: config)
    assert load_reaction_model(path).config == load_reaction_model(source).config


def test_a_pipe_is_refused_unopened(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "w.safetensors")
    with pytest.raises(StoreError, match="wanted a file; got a named pipe"):
        read_weights(tmp_path / "w.safetensors")
