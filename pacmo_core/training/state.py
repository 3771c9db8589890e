"""State of networks and optimisers as flat tables of tensors; moving averages; finite losses."""

import copy
import math
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any, TypeVar

import torch
from torch import Tensor, nn

Model = TypeVar("Model", bound=nn.Module)


def join_tables(**parts: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Join tables under ``part/name``."""
    return {
        f"{part}/{name}": value for part, table in parts.items() for name, value in table.items()
    }


def select_table(table: Mapping[str, Tensor], part: str) -> dict[str, Tensor]:
    """Take one part out of what ``prefixed`` joined."""
    return {
        name.removeprefix(f"{part}/"): value
        for name, value in table.items()
        if name.startswith(f"{part}/")
    }


def adam_state(optimiser: torch.optim.Adam) -> dict[str, Tensor]:
    """Take an optimiser's moments and counts; its learning rate is a function of the epoch."""
    per_parameter = optimiser.state_dict()["state"]
    return join_tables(**{str(index): values for index, values in per_parameter.items()})


def load_adam_state(optimiser: torch.optim.Adam, table: Mapping[str, Tensor]) -> None:
    """Give an optimiser what ``adam_state`` took; an empty table is one that never stepped."""
    indices = {name.partition("/")[0] for name in table}
    # Copies: Adam keeps the tensors it is given, and moves them in place.
    moments = {
        int(index): {name: value.clone() for name, value in select_table(table, index).items()}
        for index in indices
    }
    groups = optimiser.state_dict()["param_groups"]
    optimiser.load_state_dict({"state": moments, "param_groups": groups})


def check_finite(terms: Mapping[str, Tensor], where: str) -> dict[str, float]:
    """Read the terms of a loss as numbers.

    Raises
    ------
    FloatingPointError
        If one is not finite; the message names it.
    """
    # Stacked, so that a GPU is waited for once.
    numbers = torch.stack([term.detach() for term in terms.values()]).tolist()
    values = dict(zip(terms, numbers, strict=True))
    broken = [name for name, value in values.items() if not math.isfinite(value)]
    if broken:
        raise FloatingPointError(f"{where}: {', '.join(broken)} not finite; terms {values}")
    return values


def ema_copy(model: Model) -> Model:
    """Copy a model to hold the running mean of its weights."""
    return copy.deepcopy(model).requires_grad_(False)


def update_ema(mean: nn.Module, model: nn.Module, keep: float) -> None:
    """Move the running mean of the weights towards the model, in place."""
    with torch.no_grad():
        for ours, theirs in zip(mean.parameters(), model.parameters(), strict=True):
            ours.lerp_(theirs, 1 - keep)


def model_state(model: nn.Module) -> dict[str, Tensor]:
    """Take a model's weights and buffers as safetensors wants them: contiguous, on the CPU."""
    return {name: value.detach().cpu().contiguous() for name, value in model.state_dict().items()}


def model_config(model: nn.Module) -> dict[str, Any]:
    """Describe a model's configuration, the dataclass ``model.config``, in JSON's terms."""
    config: Any = model.config
    return asdict(config)
