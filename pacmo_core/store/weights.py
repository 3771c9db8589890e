"""Weights of networks in safetensors, their configuration as JSON in the same file."""

import json
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file

from pacmo_core.store.files import StoreError, atomic_file


def write_weights(path: Path, config: dict[str, Any], state: dict[str, torch.Tensor]) -> None:
    """Write a network's configuration and state whole or not at all."""
    tensors = {name: tensor.detach().cpu().contiguous() for name, tensor in state.items()}
    with atomic_file(path) as partial:
        save_file(tensors, partial, metadata={"config": json.dumps(config, sort_keys=True)})


def read_weights(path: Path) -> tuple[dict[str, Any], dict[str, torch.Tensor]]:
    """Read a network's configuration and state.

    Raises
    ------
    StoreError
        If the file is not whole, or holds no configuration.
    """
    try:
        with safe_open(path, framework="pt") as file:
            config = json.loads((file.metadata() or {})["config"])
            return config, {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (SafetensorError, KeyError, json.JSONDecodeError) as fault:
        raise StoreError(f"{path}: not a whole file of weights ({fault})") from fault
