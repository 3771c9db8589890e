"""Controls of an evaluation: second samples of real motion, permuted partners, sensitivity.

Second samples of real motion give the noise floor: the value of a metric for two samples of one
distribution. Permuted partners show which metrics depend on the partner.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pacmo_core.metrics.bootstrap import Estimate, Interval, difference
from pacmo_core.metrics.catalogue import METRICS, improvement_sign

Indices = NDArray[np.intp]


def second_samples(
    clips: Sequence[str], n: int, n_replicates: int, generator: np.random.Generator
) -> list[Indices]:
    """Draw n samples without replacement, clip by clip, ``n_replicates`` times.

    The last clip of a replicate may be incomplete.

    Parameters
    ----------
    clips : the clip of each sample
    n : samples per replicate
    n_replicates : replicates, each from all samples

    Returns
    -------
    ``n_replicates`` arrays (n,) int; if there are at most n samples, all of them once
    """
    if len(clips) <= n:
        return [np.arange(len(clips))]
    return [_shuffled_by_clip(clips, generator)[:n] for _ in range(n_replicates)]


def split_halves_by_clip(
    clips: Sequence[str], generator: np.random.Generator
) -> tuple[Indices, Indices]:
    """Split samples into two halves without a common clip, as equal in size as clips allow.

    Raises
    ------
    ValueError
        If there are fewer than two clips.
    """
    order = _shuffled_by_clip(clips, generator)
    names = np.asarray(clips)[order]
    starts = np.flatnonzero(names[1:] != names[:-1]) + 1
    if not len(starts):
        raise ValueError(f"halves by clip need at least 2 clips; got {sorted(set(clips))}")
    cut = starts[np.argmin(np.abs(starts - len(order) / 2))]
    return order[:cut], order[cut:]


def _shuffled_by_clip(clips: Sequence[str], generator: np.random.Generator) -> Indices:
    """Return an order that keeps the samples of a clip together, with clips in random order."""
    _, codes = np.unique(np.asarray(clips), return_inverse=True)
    rank = generator.permutation(int(codes.max()) + 1)
    return np.argsort(rank[codes], kind="stable")


def permute_partners(
    clips: Sequence[str], actions: Sequence[str] | None, generator: np.random.Generator
) -> Indices:
    """Permute reactions so that none keeps its clip, within actions if they are given.

    Parameters
    ----------
    clips : the clip of each of n samples (the two people of a clip are two samples)
    actions : the action of each sample, to exchange within one action only; None for any action
    generator : for the permutation

    Returns
    -------
    (n,) int: partner i gets the reaction of sample ``result[i]``; every reaction is used once

    Raises
    ------
    ValueError
        If a clip has more than half of the samples that can be exchanged with it, so that no
        such permutation exists.
    """
    groups = np.zeros(len(clips)) if actions is None else np.asarray(actions)
    names = np.asarray(clips)
    result = np.arange(len(clips))
    for group in np.unique(groups):
        members = np.flatnonzero(groups == group)
        if not _all_exchangeable(names[members]):
            raise ValueError(
                f"no wrong partners among {len(members)} samples of "
                f"{'any action' if actions is None else f'action {group}'}: one clip has over half"
            )
        result[members] = members[_derangement(names[members], generator)]
    return result


def is_permutable(clips: Sequence[str], actions: Sequence[str]) -> NDArray[np.bool_]:
    """Return whether the clips of each sample's action can exchange partners, (n,)."""
    groups, names = np.asarray(actions), np.asarray(clips)
    possible = {group: _all_exchangeable(names[groups == group]) for group in np.unique(groups)}
    return np.array([possible[group] for group in groups], dtype=np.bool_)


def _all_exchangeable(names: NDArray[np.str_]) -> bool:
    return bool(2 * np.unique(names, return_counts=True)[1].max() <= len(names))


def _derangement(names: NDArray[np.str_], generator: np.random.Generator) -> Indices:
    """Shift samples by the size of the largest clip, then exchange random pairs where allowed."""
    _, codes, sizes = np.unique(names, return_inverse=True, return_counts=True)
    n = len(names)
    order = np.lexsort((generator.random(n), generator.permutation(len(sizes))[codes]))
    result = np.zeros(n, dtype=np.intp)
    result[order] = np.roll(order, -int(sizes.max()))
    # The shift alone keeps the order of the clips; random exchanges reach every permutation.
    for i, j in generator.integers(n, size=(20 * n, 2)):
        if codes[i] != codes[result[j]] and codes[j] != codes[result[i]]:
            result[i], result[j] = result[j], result[i]
    return result


# Published protocols have no paired replicates, and multimodality has no direction.
TESTED = tuple(
    name
    for name, metric in METRICS.items()
    if metric.better
    and not name.endswith("_published")
    and name not in ("fid", "e_r", "e_b", "jpd")
)
EXACT_FOR_REAL = frozenset(name for name, metric in METRICS.items() if metric.exact_for_real)


@dataclass(frozen=True)
class SensitivityInterval(Interval):
    """The paired difference of true minus permuted pairs, and whether the metric separates them.

    Parameters
    ----------
    sensitive : the interval excludes zero, in the direction of improvement if there is one
    """

    sensitive: bool


def sensitivity(
    true: Mapping[str, Estimate],
    permuted: Mapping[str, Estimate],
    confidence: float,
    *,
    left_out: frozenset[str] = frozenset(),
) -> dict[str, SensitivityInterval]:
    """Return the sensitivity of every metric that both rows have, by paired replicates.

    Parameters
    ----------
    true, permuted : metrics of the true pairs, and of the same reactions with other partners
    left_out : ``EXACT_FOR_REAL`` if the true pairs are the real ones
    """
    names = [name for name in TESTED if name in true and name in permuted and name not in left_out]
    return {
        name: _sensitivity_of(name, difference(true[name], permuted[name], confidence))
        for name in names
    }


def _sensitivity_of(name: str, result: Interval) -> SensitivityInterval:
    below, above = result.high < 0, result.low > 0
    sensitive = {-1: below, 0: below or above, 1: above}[improvement_sign(name)]
    return SensitivityInterval(
        result.mean,
        result.low,
        result.high,
        bool(sensitive) and not METRICS[name].partner_independent,
    )
