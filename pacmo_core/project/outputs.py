"""Outputs of DVC stages that the parameters no longer define, and their removal.

DVC does not delete the outputs of folds, seeds or models that ``params.yaml`` no longer names,
and pooled scores are computed from all files of a folder. Removed outputs stay in DVC's cache:
a later run restores them.
"""

import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

# Paths below these: FOLD or FOLD.suffix, and in a fold's folder MODEL/SEED or MODEL/SEED.suffix.
RUN_FOLDERS = (
    *("data/splits", "data/reactions", "data/scores"),
    *("models", "reports/curves", "reports/split"),
)
AUGMENTED = "pacmo_augmented"
UNTRAINED = ("oracle", "mean", "nearest_neighbour", "nearest_neighbour_finished")
UNFINISHED = "_without_finish"  # reactions of a model as it generates them
# Of skeleton priors, below these: DATASET/SPLIT or DATASET/SPLIT.suffix, for all models of a split.
SPLIT_FOLDERS = ("data/priors/splits", "data/priors/scores", "data/priors/samples")
# Below these: DATASET/SPLIT/MODEL/SEED or DATASET/SPLIT/MODEL/SEED.suffix.
MODEL_FOLDERS = ("models/priors", "reports/curves/priors")


@dataclass(frozen=True)
class ExpectedPriors:
    """The skeleton priors that the parameters define: all combinations.

    Parameters
    ----------
    datasets, splits, models : names
    seeds : of the training runs
    """

    datasets: list[str]
    splits: list[str]
    models: list[str]
    seeds: list[int]


@dataclass(frozen=True)
class ExpectedRuns:
    """The training runs that the parameters define.

    Parameters
    ----------
    folds, seeds : of all reaction models
    models : reaction models that are trained, variants of PaCMO among them; None for any
    augmented_folds, augmented_seeds : of PaCMO trained on variations as well
    priors : skeleton priors
    """

    folds: list[int]
    seeds: list[int]
    models: list[str] | None
    augmented_folds: list[int]
    augmented_seeds: list[int]
    priors: ExpectedPriors

    def seeds_of(self, model: str, fold: int) -> list[int]:
        """Return the seeds of a model in a fold."""
        if model == AUGMENTED:
            return self.augmented_seeds if fold in self.augmented_folds else []
        if model in UNTRAINED:  # once a fold, whatever the seeds
            return [1]
        trained = model.removesuffix(UNFINISHED)
        return self.seeds if self.models is None or trained in self.models else []


def unused_outputs(root: Path, expected: ExpectedRuns) -> Iterator[Path]:
    """Yield files and folders of folds, seeds and priors other than the expected ones."""
    for folder in RUN_FOLDERS:
        yield from _other_numbers(root / folder, expected.folds)
        for fold in expected.folds:
            for model in _subfolders(root / folder / str(fold)):
                yield from _other_numbers(model, expected.seeds_of(model.name, fold))
    yield from unused_prior_outputs(root, expected.priors)


def unused_prior_outputs(root: Path, expected: ExpectedPriors) -> Iterator[Path]:
    """Yield files and folders of priors other than the expected ones; a folder, not its files."""
    names = (expected.datasets, expected.splits, expected.models, list(map(str, expected.seeds)))
    for folder in SPLIT_FOLDERS:
        yield from _other_priors(root / folder, names[:2])
    for folder in MODEL_FOLDERS:
        yield from _other_priors(root / folder, names)


def remove_outputs(root: Path, expected: ExpectedRuns) -> list[Path]:
    """Remove unused outputs and return their paths."""
    unused = list(unused_outputs(root, expected))
    for path in unused:
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink()
    return unused


def _subfolders(folder: Path) -> list[Path]:
    return sorted(path for path in folder.glob("*") if path.is_dir())


def _other_numbers(folder: Path, expected: list[int]) -> Iterator[Path]:
    for path in sorted(folder.glob("*")):
        number = path.name.partition(".")[0]
        if number.isdigit() and int(number) not in expected:
            yield path


def _other_priors(folder: Path, levels: tuple[list[str], ...]) -> Iterator[Path]:
    for path in sorted(folder.glob("*")):
        # DVC writes a .gitignore beside its outputs.
        if path.name.startswith("."):
            continue
        if path.name.partition(".")[0] not in levels[0]:
            yield path
        elif len(levels) > 1 and path.is_dir():
            yield from _other_priors(path, levels[1:])
