"""Training of one network on one loss with Adam, and helpers on batches and learning rates."""

from collections.abc import Callable, Mapping, Sequence
from typing import Generic, Protocol, TypeVar

import torch
from torch import Tensor, nn

from pacmo_core.training.loop import VALIDATION
from pacmo_core.training.state import (
    adam_state,
    add_prefixes,
    check_finite,
    load_adam_state,
    select_prefix,
)

Model = TypeVar("Model", bound=nn.Module)


class SupervisedSettings(Protocol):
    """The part of a training section of ``params.yaml`` that Adam needs."""

    @property
    def learning_rate(self) -> float:
        """Learning rate of Adam in the first epoch."""

    @property
    def halve_learning_rate_every(self) -> int:
        """Epochs after which the learning rate is halved."""

    @property
    def batch_size(self) -> int:
        """Rows in a batch."""


class SupervisedTrainer(Generic[Model]):
    """Minimise a loss with Adam over random batches; an epoch takes every row once.

    Parameters
    ----------
    model : trained in place
    n_rows : of the training data
    loss : from row numbers to the mean loss over these rows
    validation_loss : loss on validation data, None without; called without gradients
    settings : SupervisedSettings
    random : CPU generator of the order of rows
    """

    def __init__(
        self,
        model: Model,
        n_rows: int,
        loss: Callable[[Tensor], Tensor],
        validation_loss: Callable[[], Tensor] | None,
        settings: SupervisedSettings,
        random: torch.Generator,
    ) -> None:
        self._model, self.n_rows = model, n_rows
        self.loss, self.validation_loss = loss, validation_loss
        self.settings, self.random = settings, random
        self.optimiser = torch.optim.Adam(model.parameters(), lr=settings.learning_rate)

    @property
    def model(self) -> Model:
        """The model that is trained."""
        return self._model

    def train_epoch(self, number: int) -> dict[str, float]:
        """Take every row once; ``loss`` is the mean over the batches."""
        settings = self.settings
        set_learning_rate(
            self.optimiser,
            settings.learning_rate,
            epoch=number,
            every=settings.halve_learning_rate_every,
        )
        losses = [
            self._step(rows)
            for rows in random_batches(self.n_rows, settings.batch_size, self.random)
        ]
        return check_finite({"loss": torch.stack(losses).mean()}, type(self._model).__name__)

    def validate(self) -> dict[str, Tensor]:
        """Return the loss on validation data."""
        if self.validation_loss is None:
            return {}
        with torch.no_grad():
            return {VALIDATION: self.validation_loss()}

    def state_dict(self) -> dict[str, Tensor]:
        """Return weights, Adam's moments and the state of the random generator."""
        return add_prefixes(
            model=self._model.state_dict(),
            adam=adam_state(self.optimiser),
            random={"state": self.random.get_state()},
        )

    def load_state_dict(self, state: Mapping[str, Tensor]) -> None:
        """Restore what ``state_dict`` returned."""
        self._model.load_state_dict(select_prefix(state, "model"))
        load_adam_state(self.optimiser, select_prefix(state, "adam"))
        self.random.set_state(state["random/state"])

    def _step(self, rows: Tensor) -> Tensor:
        loss = self.loss(rows)
        check_finite({"loss": loss}, type(self._model).__name__)
        self.optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]  # torch leaves it untyped
        self.optimiser.step()
        return loss.detach()


def random_batches(n: int, batch_size: int, random: torch.Generator) -> list[Tensor]:
    """Split a random permutation of n rows into batches of nearly equal size, none empty."""
    order = torch.randperm(n, generator=random)
    return list(order.chunk(max(1, round(n / batch_size))))


def set_learning_rate(
    optimiser: torch.optim.Optimizer, rate: float, *, epoch: int, every: int
) -> None:
    """Set the learning rate of an epoch, from 0: halved every ``every`` epochs (PaCMO, 4.2)."""
    for group in optimiser.param_groups:
        group["lr"] = rate * 0.5 ** (epoch // every)


def mean_terms(steps: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Average each loss term over steps."""
    return {name: sum(terms[name] for terms in steps) / len(steps) for name in steps[0]}
