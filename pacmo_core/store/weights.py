"""Weights of networks in safetensors, with their configuration as JSON in the same file."""

import errno
import json
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file

from pacmo_core.data.limits import file_fault
from pacmo_core.store.files import StoreError, atomic_file

MAX_WEIGHTS_BYTES = 1 << 30  # of a file of weights, or of a checkpoint

# Of safetensors and JSON on damaged files, and of torch on types of numbers that it does not have.
_FAULTS = (SafetensorError, KeyError, ValueError, AttributeError, RuntimeError, TypeError)


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
        If the file is damaged, too large, or contains no configuration.
    """
    if fault := file_fault(path, MAX_WEIGHTS_BYTES):
        raise StoreError(f"{path}: {fault}")
    try:
        with safe_open(path, framework="pt") as file:
            config = json.loads((file.metadata() or {})["config"])
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except _FAULTS as error:
        raise StoreError(f"{path}: not a complete file of weights ({error})") from error
    if not isinstance(config, dict):
        kind = type(config).__name__
        raise StoreError(f"{path}: not a complete file of weights (its configuration is a {kind})")
    return config, tensors
