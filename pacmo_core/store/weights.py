"""Weights of networks in safetensors, with their configuration as JSON in the same file."""

import errno
import json
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file

from pacmo_core.store.files import StoreError, atomic_file


def write_weights(path: Path, config: dict[str, Any], state: dict[str, torch.Tensor]) -> None:
    """Write the configuration and the state of a network atomically."""
    tensors = {name: tensor.detach().cpu().contiguous() for name, tensor in state.items()}
    with atomic_file(path) as partial:
        try:
            save_file(tensors, partial, metadata={"config": json.dumps(config, sort_keys=True)})
        except SafetensorError as error:  # a full disk
            raise OSError(errno.EIO, str(error)) from error


def read_weights(path: Path) -> tuple[dict[str, Any], dict[str, torch.Tensor]]:
    """Read the configuration and the state of a network.

    Raises
    ------
    StoreError
        If the file is damaged or contains no configuration.
    """
    try:
        with safe_open(path, framework="pt") as file:
            config = json.loads((file.metadata() or {})["config"])
            return config, {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (SafetensorError, KeyError, json.JSONDecodeError) as error:
        raise StoreError(f"{path}: not a complete file of weights ({error})") from error
