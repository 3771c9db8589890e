"""Training of one network on one loss with Adam, and helpers on batches and learning rates."""

from collections.abc import Callable, Mapping, Sequence
from typing import Generic, Protocol, TypeVar

import torch
from torch import Tensor, nn

from pacmo_core.training.state import (
    adam_state,
    check_finite,
    join_tables,
    load_adam_state,
    select_table,
)

Model = TypeVar("Model", bound=nn.Module)


class SupervisedSettings(Protocol):
    """What a section says about one model's descent."""

    @property
    def learning_rate(self) -> float:
        """Of Adam, in the first epoch."""

    @property
    def halve_learning_rate_every(self) -> int:
        """Epochs."""

    @property
    def batch_size(self) -> int:
        """Rows."""


class SupervisedTrainer(Generic[Model]):
    """Descend a loss over batches of rows in random order; an epoch sees every row once.

    Parameters
    ----------
    model : trained in place
    n_rows : of the training data
    loss : mean over the rows given
    held_out : loss on held-out data, nothing if there are none; called without gradients
    settings : DescentSettings
    random : CPU generator of the order
    """

    def __init__(
        self,
        model: Model,
        n_rows: int,
        loss: Callable[[Tensor], Tensor],
        held_out: Callable[[], Tensor] | None,
        settings: SupervisedSettings,
        random: torch.Generator,
    ) -> None:
        self._model, self.n_rows, self.loss, self.held_out = model, n_rows, loss, held_out
        self.settings, self.random = settings, random
        self.optimiser = torch.optim.Adam(model.parameters(), lr=settings.learning_rate)

    @property
    def model(self) -> Model:
        """The one model."""
        return self._model

    def epoch(self, number: int) -> dict[str, float]:
        """See every row once; ``loss`` is the mean over the batches."""
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

    def score(self) -> Tensor | None:
        """Take the loss on held-out data."""
        if self.held_out is None:
            return None
        with torch.no_grad():
            return self.held_out()

    def state(self) -> dict[str, Tensor]:
        """Take weights, moments and the order's generator."""
        return join_tables(
            model=self._model.state_dict(),
            adam=adam_state(self.optimiser),
            random={"state": self.random.get_state()},
        )

    def load(self, state: Mapping[str, Tensor]) -> None:
        """Go back to where ``state`` was taken."""
        self._model.load_state_dict(select_table(state, "model"))
        load_adam_state(self.optimiser, select_table(state, "adam"))
        self.random.set_state(state["random/state"])

    def _step(self, rows: Tensor) -> Tensor:
        loss = self.loss(rows)
        check_finite({"loss": loss}, type(self._model).__name__)
        self.optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]  # torch leaves it untyped
        self.optimiser.step()
        return loss.detach()


def random_batches(n: int, batch_size: int, random: torch.Generator) -> list[Tensor]:
    """Cut a random order of n rows into batches of nearly one size, none of them empty."""
    order = torch.randperm(n, generator=random)
    return list(order.chunk(max(1, round(n / batch_size))))


def set_learning_rate(
    optimiser: torch.optim.Optimizer, rate: float, *, epoch: int, every: int
) -> None:
    """Set the learning rate of an epoch, from 0: halved every so many (PaCMO, 4.2)."""
    for group in optimiser.param_groups:
        group["lr"] = rate * 0.5 ** (epoch // every)


def mean_terms(rounds: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Average the terms of equally many steps each."""
    return {name: sum(terms[name] for terms in rounds) / len(rounds) for name in rounds[0]}
