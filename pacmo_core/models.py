"""Trained models from their files."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from torch import Tensor

from pacmo_core.reaction import baselines, generator
from pacmo_core.reaction.windows import ReactionModel
from pacmo_core.store.files import StoreError
from pacmo_core.store.weights import read_weights

BUILDERS: dict[str, Callable[[Mapping[str, Any], Mapping[str, Tensor]], ReactionModel]] = {
    "pacmo": generator.generator_from_state,
    "regression": generator.generator_from_state,
    "gru": baselines.gru_from_state,
}


def load(path: Path | str) -> ReactionModel:
    """Build a model that reacts from its ``weights.safetensors``; nothing is unpickled.

    Raises
    ------
    OSError
        If there is no such file.
    StoreError
        If the file is not whole, or holds a model that does not react.
    """
    Path(path).stat()  # an error of the system names the file, safetensors' does not
    config, state = read_weights(Path(path))
    kind = config.get("kind")
    if kind not in BUILDERS:
        raise StoreError(f"{path}: wanted a model of {', '.join(BUILDERS)}; got {kind}")
    return BUILDERS[kind](config["model"], state)
