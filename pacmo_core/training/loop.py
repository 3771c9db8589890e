"""The training loop of every model: epochs, validation, best weights, exact resumption."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

from torch import Tensor, nn

from pacmo_core.training.state import check_finite, join_tables, model_state, select_table

Model = TypeVar("Model", bound=nn.Module)
Example = TypeVar("Example")
Handed = TypeVar("Handed", bound=nn.Module, covariant=True)

VALIDATION = "validation"


@dataclass(frozen=True)
class TrainingData(Generic[Example]):
    """The training and validation split of a data set, in memory.

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


class Trainer(Protocol[Handed]):
    """A model in training, as ``Fit`` sees it."""

    @property
    def model(self) -> Handed:
        """What would be handed over now."""

    def epoch(self, number: int) -> dict[str, float]:
        """Train through epoch ``number``, from 0; return the means of its terms."""

    def score(self) -> Tensor | None:
        """Judge ``model`` on held-out clips, lower is better; nothing if there are none."""

    def state(self) -> dict[str, Tensor]:
        """Take all that the epochs to come depend on."""

    def load(self, state: Mapping[str, Tensor]) -> None:
        """Go back to where ``state`` was taken."""


@dataclass(frozen=True)
class Snapshot:
    """A fit between two epochs.

    Parameters
    ----------
    tensors : of the training, and of the best weights so far
    facts : the curve and the choice so far, in JSON's terms
    """

    tensors: dict[str, Tensor]
    facts: dict[str, Any]


class TrainingLoop(Generic[Model]):
    """A training and what remains of it: iterate to train; each epoch yields its terms.

    When the terms are exhausted ``model`` holds the weights that scored best on held-out clips,
    the first of equals; without such clips, the last.

    Parameters
    ----------
    training : Training
    n_epochs : int
    validate_every : epochs from one look at held-out clips to the next; the last epoch is looked at

    Raises
    ------
    ValueError
        If a number is less than 1.
    """

    def __init__(self, training: Trainer[Model], *, n_epochs: int, validate_every: int) -> None:
        if min(n_epochs, validate_every) < 1:
            raise ValueError(
                f"n_epochs and validate_every must be at least 1; got {n_epochs}, {validate_every}"
            )
        self.training, self.n_epochs, self.validate_every = training, n_epochs, validate_every
        self.curve: list[dict[str, float]] = []
        self._best: dict[str, Tensor] = {}
        self._best_epoch = 0

    @property
    def model(self) -> Model:
        """The model, trained in place."""
        return self.training.model

    def __iter__(self) -> Iterator[dict[str, float]]:
        while len(self.curve) < self.n_epochs:
            terms = self.training.epoch(len(self.curve))
            epoch = len(self.curve) + 1
            if epoch % self.validate_every == 0 or epoch == self.n_epochs:
                terms |= self._look(epoch)
            self.curve.append(terms)
            yield terms
        if self._best:
            self.model.load_state_dict(self._best)

    def finish(self) -> Model:
        """Train to the end and hand over the model."""
        for _ in self:
            pass
        return self.model

    def chosen(self) -> dict[str, Any]:
        """Say in JSON's terms which weights are handed over, and why those."""
        if not self._best:
            return {"by": "last epoch", "epoch": len(self.curve)}
        score = self.curve[self._best_epoch - 1][VALIDATION]
        return {"by": VALIDATION, "epoch": self._best_epoch, "score": score}

    def snapshot(self) -> Snapshot:
        """Copy all that the rest of the training depends on."""
        tensors = join_tables(training=self.training.state(), best=self._best)
        copies = {name: value.detach().cpu().clone() for name, value in tensors.items()}
        return Snapshot(copies, {"curve": self.curve[:], "best_epoch": self._best_epoch})

    def restore(self, snapshot: Snapshot) -> None:
        """Go back, or in another process forward, to where a snapshot was taken."""
        self.training.load(select_table(snapshot.tensors, "training"))
        self._best = select_table(snapshot.tensors, "best")
        self._best_epoch = snapshot.facts["best_epoch"]
        self.curve = [dict(terms) for terms in snapshot.facts["curve"]]

    def _look(self, epoch: int) -> dict[str, float]:
        score = self.training.score()
        if score is None:
            return {}
        terms = check_finite({VALIDATION: score}, f"epoch {epoch}")
        if not self._best or terms[VALIDATION] < self.curve[self._best_epoch - 1][VALIDATION]:
            self._best = {name: value.clone() for name, value in model_state(self.model).items()}
            self._best_epoch = epoch
        return terms
