"""MMD of (partner, reaction) pairs, with a product of kernels.

The kernel of two pairs is k((p, r), (p′, r′)) = k(p, p′) k(r, r′), both Gaussian: its discrepancy
is zero only for equal joint laws (Szabó and Sriperumbudur 2018, *Characteristic and universal
tensor product kernels*), so it sees who answers whom, which MMD of reactions alone cannot.
"""

import numpy as np

from pacmo_core.metrics.intervals import Array
from pacmo_core.metrics.mmd import mean_kernels, median_bandwidth
from pacmo_core.metrics.pairs import pair_means
from pacmo_core.metrics.reactions import Reactions
from pacmo_core.metrics.yardstick import Yardstick


class PairMmd:
    """Real pairs of second draws, and what can be computed once for all rows.

    Rows are held against second draws, where real pairs have a score of their own.

    Parameters
    ----------
    yardstick : Yardstick
    """

    def __init__(self, yardstick: Yardstick) -> None:
        self._yardstick = yardstick
        train = _motions(yardstick, yardstick.train)
        self._bandwidths = [np.array([median_bandwidth(side)]) for side in train]
        self._seconds = [_motions(yardstick, second) for second in yardstick.seconds]
        self._codes = [
            yardstick.codes(second, k) for k, second in enumerate(yardstick.seconds, start=1)
        ]
        self._within = [
            pair_means(self._kernel(pairs, pairs), codes, codes, yardstick.counts)
            for pairs, codes in zip(self._seconds, self._codes, strict=True)
        ]

    def measure(self, row: Reactions) -> Array:
        """Average the unbiased squared discrepancy to the second draws, (1 + bootstrap,)."""
        pairs, own = _motions(self._yardstick, row), self._yardstick.partners
        counts = self._yardstick.counts
        within = pair_means(self._kernel(pairs, pairs), own, own, counts)
        found = [
            within + other - 2 * pair_means(self._kernel(pairs, second), own, codes, counts)
            for second, codes, other in zip(self._seconds, self._codes, self._within, strict=True)
        ]
        return np.asarray(np.mean(found, axis=0))

    def _kernel(self, first: tuple[Array, Array], second: tuple[Array, Array]) -> Array:
        sides = zip(first, second, self._bandwidths, strict=True)
        partner, reaction = (mean_kernels(x, y, bandwidth)[0] for x, y, bandwidth in sides)
        return np.asarray(partner * reaction)


def _motions(yardstick: Yardstick, row: Reactions) -> tuple[Array, Array]:
    """Stack partners and reactions as whole sequences, two (n, 1, T·J·3)."""
    return yardstick.sequences(row.partners, row.times), yardstick.sequences(row.motions, row.times)
