"""Wrong partners: give every partner the real reaction of another clip."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Indices = NDArray[np.intp]


def wrong_partners(
    clips: Sequence[str], acts: Sequence[str] | None, generator: np.random.Generator
) -> Indices:
    """Permute reactions so that none stays in its clip, and each in its act if acts are given.

    Parameters
    ----------
    clips : the clip of each of n samples (the two people of a clip are two samples)
    acts : the act of each sample, to exchange within one act only; None for any act
    generator : deals the partners

    Returns
    -------
    (n,) int: partner i gets the reaction of sample ``result[i]``; every reaction is used once

    Raises
    ------
    ValueError
        If a clip holds more than half of the samples among which it may exchange, so that no
        such permutation exists.
    """
    groups = np.zeros(len(clips)) if acts is None else np.asarray(acts)
    names = np.asarray(clips)
    result = np.arange(len(clips))
    for group in np.unique(groups):
        members = np.flatnonzero(groups == group)
        if not _exchangeable(names[members]):
            raise ValueError(
                f"no wrong partners among {len(members)} samples of "
                f"{'any act' if acts is None else f'act {group}'}: one clip holds over half"
            )
        result[members] = members[_derangement(names[members], generator)]
    return result


def has_wrong_partner(clips: Sequence[str], acts: Sequence[str]) -> NDArray[np.bool_]:
    """Tell which samples are of an act whose clips can exchange partners, (n,)."""
    groups, names = np.asarray(acts), np.asarray(clips)
    possible = {group: _exchangeable(names[groups == group]) for group in np.unique(groups)}
    return np.array([possible[group] for group in groups], dtype=np.bool_)


def _exchangeable(names: NDArray[np.str_]) -> bool:
    return bool(2 * np.unique(names, return_counts=True)[1].max() <= len(names))


def _derangement(names: NDArray[np.str_], generator: np.random.Generator) -> Indices:
    """Shift samples by the largest clip's size, then exchange at random what may be exchanged."""
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
