"""The training loop of every model: epochs, validation, selection of weights, resumption.

The loop trains epoch by epoch, measures a validation score every so many epochs, and at the end
restores the weights with the lowest score (early stopping without stopping early). What happens in
an epoch is the ``Trainer``'s: ``SupervisedTrainer`` and ``reaction.wgan.WganTrainer``.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

from torch import Tensor, nn

from pacmo_core.training.state import add_prefixes, check_finite, model_state, select_prefix

Model = TypeVar("Model", bound=nn.Module)
Example = TypeVar("Example")
TrainedModel = TypeVar("TrainedModel", bound=nn.Module, covariant=True)

VALIDATION = "validation"


@dataclass(frozen=True)
class TrainingData(Generic[Example]):
    """The training and validation split of a dataset, in memory.

    Parameters
    ----------
    train, validation : what is trained on, and what weights are selected on; the latter may be
        empty
    train_actions, validation_actions : action label of each, if a model is conditioned on labels
    """

    train: Sequence[Example]
    validation: Sequence[Example] = ()
    train_actions: Sequence[str] = ()
    validation_actions: Sequence[str] = ()


class Trainer(Protocol[TrainedModel]):
    """A model, its optimiser and its data: what ``TrainingLoop`` repeats."""

    @property
    def model(self) -> TrainedModel:
        """The model whose weights are selected."""

    def train_epoch(self, number: int) -> dict[str, float]:
        """Train for epoch ``number``, from 0; return the means of the loss terms."""

    def validate(self) -> dict[str, Tensor]:
        """Score ``model`` on validation data: ``validation``, lower is better, and other terms.

        Empty if it is not scored now.
        """

    def state_dict(self) -> dict[str, Tensor]:
        """Return all that later epochs depend on."""

    def load_state_dict(self, state: Mapping[str, Tensor]) -> None:
        """Restore what ``state_dict`` returned."""


@dataclass(frozen=True)
class Snapshot:
    """A training loop between two epochs.

    Parameters
    ----------
    tensors : of the trainer, and the best weights so far
    facts : learning curve, number and score of the best epoch, in JSON's terms
    """

    tensors: dict[str, Tensor]
    facts: dict[str, Any]


class TrainingLoop(Generic[Model]):
    """Iterate to train: each epoch yields the means of its loss terms.

    When the iteration ends, ``model`` has the weights of the epoch with the lowest validation
    score, the first of equals; without validation data, the last. With ``validate_untrained`` the
    untrained weights are a candidate too, as epoch 0.

    Parameters
    ----------
    trainer : Trainer
    n_epochs : int
    validate_every : epochs from one validation to the next; the last epoch is always validated
    validate_untrained : whether the model is of use before training

    Raises
    ------
    ValueError
        If a number is less than 1.
    """

    def __init__(
        self,
        trainer: Trainer[Model],
        *,
        n_epochs: int,
        validate_every: int,
        validate_untrained: bool = False,
    ) -> None:
        if min(n_epochs, validate_every) < 1:
            raise ValueError(
                f"n_epochs and validate_every must be at least 1; got {n_epochs}, {validate_every}"
            )
        self.trainer, self.n_epochs, self.validate_every = trainer, n_epochs, validate_every
        self.validate_untrained = validate_untrained
        self.curve: list[dict[str, float]] = []
        # Adds to the trained model what is fitted to what it generates.
        self.complete: Callable[[Model], None] = _leave
        self._best_weights: dict[str, Tensor] = {}
        self._best_epoch, self._best_score = 0, 0.0

    @property
    def model(self) -> Model:
        """The model, trained in place."""
        return self.trainer.model

    def __iter__(self) -> Iterator[dict[str, float]]:
        if self.validate_untrained and not self.curve:
            self._validate(epoch=0)
        while len(self.curve) < self.n_epochs:
            terms = self.trainer.train_epoch(len(self.curve))
            epoch = len(self.curve) + 1
            if epoch % self.validate_every == 0 or epoch == self.n_epochs:
                terms |= self._validate(epoch)
            self.curve.append(terms)
            yield terms
        if self._best_weights:
            self.model.load_state_dict(self._best_weights)
        self.complete(self.model)

    def finish(self) -> Model:
        """Train to the end and return the model."""
        for _ in self:
            pass
        return self.model

    def selection(self) -> dict[str, Any]:
        """Return which epoch's weights are selected and by what, in JSON's terms."""
        if not self._best_weights:
            return {"by": "last epoch", "epoch": len(self.curve)}
        return {"by": VALIDATION, "epoch": self._best_epoch, "score": self._best_score}

    def snapshot(self) -> Snapshot:
        """Copy all that the rest of the training depends on."""
        tensors = add_prefixes(trainer=self.trainer.state_dict(), best=self._best_weights)
        copies = {name: value.detach().cpu().clone() for name, value in tensors.items()}
        best = {"best_epoch": self._best_epoch, "best_score": self._best_score}
        return Snapshot(copies, {"curve": self.curve[:], **best})

    def restore(self, snapshot: Snapshot) -> None:
        """Continue from a snapshot, of this process or another."""
        self.trainer.load_state_dict(select_prefix(snapshot.tensors, "trainer"))
        self._best_weights = select_prefix(snapshot.tensors, "best")
        self._best_epoch = snapshot.facts["best_epoch"]
        self._best_score = snapshot.facts["best_score"]
        self.curve = [dict(terms) for terms in snapshot.facts["curve"]]

    def _validate(self, epoch: int) -> dict[str, float]:
        scores = self.trainer.validate()
        if not scores:
            return {}
        terms = check_finite(scores, f"epoch {epoch}")
        if not self._best_weights or terms[VALIDATION] < self._best_score:
            weights = model_state(self.model)
            self._best_weights = {name: value.clone() for name, value in weights.items()}
            self._best_epoch, self._best_score = epoch, terms[VALIDATION]
        return terms


def _leave(model: nn.Module) -> None:
    """Leave a model as it was trained."""
