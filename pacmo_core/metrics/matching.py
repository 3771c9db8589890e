"""How often a network picks the true partner of a reaction among others."""

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

from pacmo_core.metrics.intervals import Array

Codes = NDArray[np.intp]


def matching(embedded: Array, codes: Codes, counts: Array, *, candidates: int) -> Array:
    """Give the share of reactions whose true partner fits best among so many candidates.

    The rivals are partners of other clips. What a random choice of them gives is worked out, not
    drawn: where w of K rivals fit at least as well as the true partner, m of them drawn without
    replacement are all worse with probability C(K − w, m) / C(K, m). (R-precision of Guo et al.
    2022, *Generating diverse and natural 3D human motions from text*, draws 31 at random.)

    Parameters
    ----------
    embedded : (2, n, E), of partners and reactions; reaction i stands before partner i
    codes : (n,) int, the column of ``counts`` of each partner's clip
    counts : (B, G) whole numbers, how often each draw took each clip; a draw's copies of a clip
        are rivals of other clips, not of each other
    candidates : the true partner and its rivals; fewer where a draw holds fewer

    Returns
    -------
    (B,)
    """
    fit = embedded[1] @ embedded[0].T  # (reactions, partners)
    foreign = codes[:, None] != codes
    better = foreign & (fit >= np.diag(fit)[:, None])
    weights = counts[:, codes]
    rivals, ahead = weights @ foreign.T, weights @ better.T
    asked = np.minimum(candidates - 1, rivals)
    picked = np.exp(_log_choices(rivals - ahead, asked) - _log_choices(rivals, asked))
    return np.asarray((weights * picked).sum(axis=1) / weights.sum(axis=1))


def candidates_in(codes: Codes, wanted: int) -> int:
    """Count the candidates: as many as wanted, or one more than the fewest rivals."""
    return min(wanted, 1 + int((codes[:, None] != codes).sum(axis=1).min()))


def _log_choices(n: Array, k: Array) -> Array:
    """Logarithm of the ways to choose k of n; of none, −∞."""
    possible = n >= k
    safe = np.where(possible, n, k)
    ways = gammaln(safe + 1) - gammaln(k + 1) - gammaln(safe - k + 1)
    return np.where(possible, ways, -np.inf)
