"""Runs that are no longer wanted: what other folds and seeds left where this experiment's stand.

DVC never deletes the outputs of a stage that the parameters no longer make, and scores are pooled
from all files of a folder. All of these are in DVC's cache: a later run links them again.
"""

import shutil
from collections.abc import Iterator
from pathlib import Path

# Below these stands FOLD or FOLD.suffix, and in a fold's folder MODEL/SEED or MODEL/SEED.suffix.
PLACES = (
    *("data/sides", "data/reactions", "data/scores"),
    *("models", "reports/curves", "reports/split"),
)


def leftovers(root: Path, folds: list[int], seeds: list[int]) -> Iterator[Path]:
    """Yield what belongs to other folds and seeds."""
    for place in PLACES:
        yield from _others(root / place, folds)
        for fold in folds:
            for model in _folders(root / place / str(fold)):
                # The oracle is drawn once a fold, whatever the seeds.
                yield from _others(model, [1] if model.name == "oracle" else seeds)


def remove_leftovers(root: Path, folds: list[int], seeds: list[int]) -> list[Path]:
    """Remove them, and say which they were."""
    found = list(leftovers(root, folds, seeds))
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
