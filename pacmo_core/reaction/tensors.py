"""The state of networks, optimisers and generators as one flat table of tensors, and back."""

from collections.abc import Mapping

import torch
from torch import Tensor


def prefixed(**parts: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Join tables under ``part/name``."""
    return {
        f"{part}/{name}": value for part, table in parts.items() for name, value in table.items()
    }


def parted(table: Mapping[str, Tensor], part: str) -> dict[str, Tensor]:
    """Take one part out of what ``prefixed`` joined."""
    return {
        name.removeprefix(f"{part}/"): value
        for name, value in table.items()
        if name.startswith(f"{part}/")
    }


def adam_state(optimiser: torch.optim.Adam) -> dict[str, Tensor]:
    """Take an optimiser's moments and counts; its learning rate is a function of the epoch."""
    per_parameter = optimiser.state_dict()["state"]
    return prefixed(**{str(index): values for index, values in per_parameter.items()})


def load_adam(optimiser: torch.optim.Adam, table: Mapping[str, Tensor]) -> None:
    """Give an optimiser what ``adam_state`` took; an empty table is one that never stepped."""
    indices = {name.partition("/")[0] for name in table}
    # Copies: Adam keeps the tensors it is given, and moves them in place.
    moments = {
        int(index): {name: value.clone() for name, value in parted(table, index).items()}
        for index in indices
    }
    groups = optimiser.state_dict()["param_groups"]
    optimiser.load_state_dict({"state": moments, "param_groups": groups})
