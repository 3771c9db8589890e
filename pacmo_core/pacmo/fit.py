"""What fitting any of the models has in common."""

import copy
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Generic, TypeVar

import torch
from torch import Tensor, nn

Model = TypeVar("Model", bound=nn.Module)


@dataclass(frozen=True)
class Fit(Generic[Model]):
    """A model and the training that remains: iterate to train; each round yields its terms.

    Parameters
    ----------
    model : trained in place; done when the terms are exhausted
    terms : an epoch's or a step's terms by name
    """

    model: Model
    terms: Iterator[dict[str, float]]

    def __iter__(self) -> Iterator[dict[str, float]]:
        return self.terms

    def finish(self) -> Model:
        """Train to the end and hand over the model."""
        for _ in self.terms:
            pass
        return self.model


def batches(n: int, batch_size: int, random: torch.Generator) -> list[Tensor]:
    """Cut a random order of n rows into batches of nearly one size, none of them empty."""
    order = torch.randperm(n, generator=random)
    return list(order.chunk(max(1, round(n / batch_size))))


def halving(optimiser: torch.optim.Optimizer, every: int) -> torch.optim.lr_scheduler.StepLR:
    """Halve the learning rate every so many rounds (PaCMO, 4.2)."""
    return torch.optim.lr_scheduler.StepLR(optimiser, step_size=every, gamma=0.5)


def running_mean(model: Model) -> Model:
    """Copy a model to hold the running mean of its weights."""
    return copy.deepcopy(model).requires_grad_(False)


def update_mean(mean: nn.Module, model: nn.Module, keep: float) -> None:
    """Move the running mean of the weights towards the model, in place."""
    with torch.no_grad():
        for ours, theirs in zip(mean.parameters(), model.parameters(), strict=True):
            ours.lerp_(theirs, 1 - keep)


def state(model: nn.Module) -> dict[str, Tensor]:
    """Take a model's weights and buffers as safetensors wants them: contiguous, on the CPU."""
    return {name: value.detach().cpu().contiguous() for name, value in model.state_dict().items()}
