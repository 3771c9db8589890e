"""Skeleton priors that are no longer wanted: those of other data sets, splits, models and seeds."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

# Below these stands FAMILY/SPLIT or FAMILY/SPLIT.suffix: all of a split's models together.
TOGETHER = ("data/priors/sides", "data/priors/scores", "data/priors/samples")
# Below these FAMILY/SPLIT/MODEL/SEED or FAMILY/SPLIT/MODEL/SEED.suffix.
APART = ("models/priors", "reports/curves/priors")


@dataclass(frozen=True)
class WantedPriors:
    """Which priors the parameters make: every one of each.

    Parameters
    ----------
    datasets, splits, models : names
    seeds : of the training runs
    """

    datasets: list[str]
    splits: list[str]
    models: list[str]
    seeds: list[int]


def leftover_priors(root: Path, wanted: WantedPriors) -> Iterator[Path]:
    """Yield what belongs to other priors; of a folder that goes whole, the folder alone."""
    levels = (wanted.datasets, wanted.splits, wanted.models, [str(s) for s in wanted.seeds])
    for place in TOGETHER:
        yield from _others(root / place, levels[:2])
    for place in APART:
        yield from _others(root / place, levels)


def _others(place: Path, levels: tuple[list[str], ...]) -> Iterator[Path]:
    for path in sorted(place.glob("*")):
        # DVC writes a .gitignore beside what it keeps.
        if path.name.startswith("."):
            continue
        if path.name.partition(".")[0] not in levels[0]:
            yield path
        elif len(levels) > 1 and path.is_dir():
            yield from _others(path, levels[1:])
