"""Fresh weights from an explicit generator: torch's own constructors draw from a global one."""

import math

import torch
from torch import nn

from pacmo_core.operators.spectral import SpectralLayer


def initialise(module: nn.Module, random: torch.Generator) -> None:
    """Draw anew, in order, all weights below ``module``, by the laws that torch's layers use.

    Raises
    ------
    ValueError
        If a layer with weights of its own is of a kind that this function does not know.
    """
    for layer in module.modules():
        if isinstance(layer, SpectralLayer):
            layer.initialise(random)
        elif isinstance(layer, nn.Linear):
            _uniform(layer, 1 / math.sqrt(layer.in_features), random)
        elif isinstance(layer, nn.GRU):
            _uniform(layer, 1 / math.sqrt(layer.hidden_size), random)
        elif next(layer.parameters(recurse=False), None) is not None:
            raise ValueError(f"no law for the weights of {type(layer).__name__}")


def _uniform(layer: nn.Module, bound: float, random: torch.Generator) -> None:
    with torch.no_grad():
        for weight in layer.parameters(recurse=False):
            weight.copy_(torch.empty(weight.shape).uniform_(-bound, bound, generator=random))
