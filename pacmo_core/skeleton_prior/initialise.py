"""Fresh weights from an explicit generator: torch's own constructors draw from a global one."""

import math

import torch
from torch import nn

from pacmo_core.skeleton_prior.layers import GraphConvolution, Silent
from pacmo_core.skeleton_prior.recurrence import GraphGru

# Weights that start where their constructor puts them: at the identity.
FIXED = (GraphConvolution, GraphGru, nn.BatchNorm1d)


def initialise(module: nn.Module, random: torch.Generator) -> None:
    """Draw anew, in order, all weights below ``module``, by the laws that torch's layers use.

    Raises
    ------
    ValueError
        If a layer with weights of its own is of a kind that this function does not know.
    """
    for layer in module.modules():
        if isinstance(layer, Silent):
            nn.init.zeros_(layer.weight)
            nn.init.zeros_(layer.bias)
        elif isinstance(layer, nn.Linear):
            bound = 1 / math.sqrt(math.prod(layer.weight.shape[1:]))
            with torch.no_grad():
                for weight in layer.parameters(recurse=False):
                    drawn = torch.empty(weight.shape).uniform_(-bound, bound, generator=random)
                    weight.copy_(drawn)
        elif isinstance(layer, FIXED):
            continue
        elif next(layer.parameters(recurse=False), None) is not None:
            raise ValueError(f"no law for the weights of {type(layer).__name__}")
