"""Runs that are no longer wanted: what other folds and seeds left where this experiment's stand.

DVC never deletes the outputs of a stage that the parameters no longer make, and scores are pooled
from all files of a folder. All of these are in DVC's cache: a later run links them again.
"""

import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from apps.leftover_priors import WantedPriors, leftover_priors

# Below these stands FOLD or FOLD.suffix, and in a fold's folder MODEL/SEED or MODEL/SEED.suffix.
PLACES = (
    *("data/splits", "data/reactions", "data/scores"),
    *("models", "reports/curves", "reports/split"),
)


AUGMENTED = "pacmo_augmented"


@dataclass(frozen=True)
class Wanted:
    """Which runs the parameters make.

    Parameters
    ----------
    folds, seeds : of all models
    augmented_folds, augmented_seeds : of PaCMO trained on variations too
    priors : skeleton priors
    """

    folds: list[int]
    seeds: list[int]
    augmented_folds: list[int]
    augmented_seeds: list[int]
    priors: WantedPriors

    def seeds_of(self, model: str, fold: int) -> list[int]:
        """List the seeds of a model in a fold."""
        if model == AUGMENTED:
            return self.augmented_seeds if fold in self.augmented_folds else []
        # The oracle is drawn once a fold, whatever the seeds.
        return [1] if model == "oracle" else self.seeds


def leftovers(root: Path, wanted: Wanted) -> Iterator[Path]:
    """Yield what belongs to other folds, seeds and priors."""
    for place in PLACES:
        yield from _others(root / place, wanted.folds)
        for fold in wanted.folds:
            for model in _folders(root / place / str(fold)):
                yield from _others(model, wanted.seeds_of(model.name, fold))
    yield from leftover_priors(root, wanted.priors)


def remove_leftovers(root: Path, wanted: Wanted) -> list[Path]:
    """Remove them, and say which they were."""
    found = list(leftovers(root, wanted))
    for path in found:
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink()
    return found


def _folders(place: Path) -> list[Path]:
    return sorted(path for path in place.glob("*") if path.is_dir())


def _others(place: Path, wanted: list[int]) -> Iterator[Path]:
    for path in sorted(place.glob("*")):
        number = path.name.partition(".")[0]
        if number.isdigit() and int(number) not in wanted:
            yield path
