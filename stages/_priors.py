"""Which skeleton priors an experiment trains, and where their files stand."""

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import pacmo_core
from stages._params import read_params

# What a training of a skeleton prior runs, beside what every training does.
ROOM = "skeleton_prior"


@dataclass(frozen=True)
class Priors:
    """The part ``priors`` of the section ``runs``: a model for each of these.

    Parameters
    ----------
    families : folders of variations, each of one skeleton
    splits : names of splits; with ``_N`` after one, N samples to train on
    models : names of forms
    seeds : of the training runs
    """

    families: list[str]
    splits: list[str]
    models: list[str]
    seeds: list[int]

    def groups(self) -> Iterator[tuple[str, str]]:
        """Yield each family and split that models are judged on together."""
        return product(self.families, self.splits)


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


def room_hash() -> str:
    """SHA-256 of the room's code, in hexadecimal: no checkpoint of other code is gone on from."""
    digest = hashlib.sha256()
    for path in sorted((Path(pacmo_core.__path__[0]) / ROOM).glob("*.py")):
        digest.update(path.name.encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()
