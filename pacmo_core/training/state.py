"""State of networks and optimisers as flat dictionaries of tensors, EMA, finite losses."""

import copy
import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from typing import Any, TypeVar

import torch
from torch import Tensor, nn

Model = TypeVar("Model", bound=nn.Module)


def add_prefixes(**parts: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Join dictionaries of tensors, with keys ``part/name``."""
    return {
        f"{part}/{name}": value for part, table in parts.items() for name, value in table.items()
    }


def select_prefix(table: Mapping[str, Tensor], part: str) -> dict[str, Tensor]:
    """Return one part of what ``add_prefixes`` joined."""
    return {
        name.removeprefix(f"{part}/"): value
        for name, value in table.items()
        if name.startswith(f"{part}/")
    }


def adam_state(optimiser: torch.optim.Adam) -> dict[str, Tensor]:
    """Return Adam's moments and step counts; its learning rate is a function of the epoch."""
    per_parameter = optimiser.state_dict()["state"]
    return add_prefixes(**{str(index): values for index, values in per_parameter.items()})


def load_adam_state(optimiser: torch.optim.Adam, table: Mapping[str, Tensor]) -> None:
    """Restore what ``adam_state`` returned; it is empty before the first step."""
    indices = {name.partition("/")[0] for name in table}
    # Copies: Adam keeps these tensors and updates them in place.
    moments = {
        int(index): {name: value.clone() for name, value in select_prefix(table, index).items()}
        for index in indices
    }
    groups = optimiser.state_dict()["param_groups"]
    optimiser.load_state_dict({"state": moments, "param_groups": groups})


def check_finite(terms: Mapping[str, Tensor], where: str) -> dict[str, float]:
    """Convert the terms of a loss to numbers.

    Raises
    ------
    FloatingPointError
        If one is not finite; the message names it.
    """
    # Stacked, so that there is one synchronisation with a GPU.
    numbers = torch.stack([term.detach() for term in terms.values()]).tolist()
    values = dict(zip(terms, numbers, strict=True))
    infinite = [name for name, value in values.items() if not math.isfinite(value)]
    if infinite:
        raise FloatingPointError(f"{where}: {', '.join(infinite)} not finite; terms {values}")
    return values


def ema_copy(model: Model) -> Model:
    """Copy a model to hold the exponential moving average (EMA) of its weights."""
    return copy.deepcopy(model).requires_grad_(False)


def update_ema(
    average: nn.Module,
    model: nn.Module,
    decay: float,
    start: nn.Module | None = None,
    share: float = 0.0,
) -> None:
    """Update an EMA in place: ``average = decay * average + (1 - decay) * model``.

    With a ``start``, ``share * start + (1 - share) * model`` takes the place of the model.
    """
    weights: Iterable[Tensor] = model.parameters()
    with torch.no_grad():
        if start is not None:
            both = zip(weights, start.parameters(), strict=True)
            weights = (torch.lerp(weight, first, share) for weight, first in both)
        for mean, weight in zip(average.parameters(), weights, strict=True):
            mean.lerp_(weight, 1 - decay)


def model_state(model: nn.Module) -> dict[str, Tensor]:
    """Return a model's weights and buffers as safetensors needs them: contiguous, on the CPU."""
    return {name: value.detach().cpu().contiguous() for name, value in model.state_dict().items()}


def model_config(model: nn.Module) -> dict[str, Any]:
    """Return a model's configuration, the dataclass ``model.config``, as a dictionary for JSON."""
    config: Any = model.config
    return asdict(config)
