"""Which skeleton priors an experiment trains, and where their files stand."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

from stages._params import read_params


@dataclass(frozen=True)
class Priors:
    """The part ``priors`` of the section ``runs``: a model for each of these.

    Parameters
    ----------
    datasets : folders of variations, each of one skeleton
    splits : names of splits; with ``_N`` after one, N samples to train on
    models : names of forms
    seeds : of the training runs
    """

    datasets: list[str]
    splits: list[str]
    models: list[str]
    seeds: list[int]

    def groups(self) -> Iterator[tuple[str, str]]:
        """Yield each data set and split that models are judged on together."""
        return product(self.datasets, self.splits)


@dataclass(frozen=True)
class Runs:
    """The ``runs`` section of ``params.yaml``."""

    folds: list[int]
    seeds: list[int]
    priors: Priors


def read_priors() -> Priors:
    """Read which priors are wanted."""
    return read_params("runs", Runs).priors


def split_and_samples(name: str) -> tuple[str, int | None]:
    """Part ``cross_scale_24`` into the split and the number of samples; without one, all."""
    split, _, number = name.rpartition("_")
    return (split, int(number)) if number.isdigit() else (name, None)
