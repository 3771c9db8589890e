"""MMD of (partner, reaction) pairs, with a product of kernels.

The kernel of two pairs is k((p, r), (p′, r′)) = k(p, p′) k(r, r′), both Gaussian: its discrepancy
is zero only for equal joint laws (Szabó and Sriperumbudur 2018, *Characteristic and universal
tensor product kernels*), so it sees who answers whom, which MMD of reactions alone cannot.
"""

import numpy as np

from pacmo_core.metrics.intervals import Array
from pacmo_core.metrics.mmd import mean_kernels, median_bandwidth
from pacmo_core.metrics.pairs import Codes, pair_means
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

    def dealt(self, row: Reactions, groups: Codes) -> Array:
        """Measure as ``measure`` does, in the mean over all dealings of the reactions.

        Dealt at random within each group, pairs follow the product of the marginal laws, so the
        kernel's means are products of means and no dealing need be drawn. A draw's partners and
        reactions weigh as they do in ``measure``: what a difference of the two shows is the
        pairing alone. One dealing would add its own noise, about twice as much as there is.

        Parameters
        ----------
        row : reactions to their own partners
        groups : (n,) int; reactions are dealt within their group

        Returns
        -------
        (1 + bootstrap,)
        """
        pairs = _motions(self._yardstick, row)
        members = groups == np.unique(groups)[:, None]
        drawn = members * self._yardstick.counts[:, None, self._yardstick.partners]  # (B, A, n)
        sizes = drawn.sum(axis=2)
        shares = sizes / sizes.sum(axis=1, keepdims=True)
        mean = drawn / np.maximum(sizes, 1)[:, :, None]  # a group may be absent from a draw
        within = self._dealt_within(pairs, drawn, shares)
        found = []
        for second, codes, other in zip(self._seconds, self._codes, self._within, strict=True):
            partner, reaction = self._kernels(pairs, second)
            weights = self._yardstick.counts[:, codes]
            weights = weights / weights.sum(axis=1, keepdims=True)
            between = (mean @ partner) * (mean @ reaction)
            found.append(within + other - 2 * np.einsum("ba,bam,bm->b", shares, between, weights))
        return np.asarray(np.mean(found, axis=0))

    def _dealt_within(self, pairs: tuple[Array, Array], drawn: Array, shares: Array) -> Array:
        own = self._yardstick.partners
        foreign = (own[:, None] != own).astype(np.float64)
        numbers = _group_sums(drawn, foreign)
        partner, reaction = (
            _group_sums(drawn, kernel * foreign) / np.maximum(numbers, 1)
            for kernel in self._kernels(pairs, pairs)
        )
        # A group of which a draw has one clip is not compared with itself.
        weights = shares[:, :, None] * shares[:, None, :] * (numbers > 0)
        return np.asarray((weights * partner * reaction).sum((1, 2)) / weights.sum((1, 2)))

    def _kernel(self, first: tuple[Array, Array], second: tuple[Array, Array]) -> Array:
        partner, reaction = self._kernels(first, second)
        return np.asarray(partner * reaction)

    def _kernels(
        self, first: tuple[Array, Array], second: tuple[Array, Array]
    ) -> tuple[Array, Array]:
        sides = zip(first, second, self._bandwidths, strict=True)
        partner, reaction = (mean_kernels(x, y, bandwidth)[0] for x, y, bandwidth in sides)
        return partner, reaction


def _group_sums(drawn: Array, values: Array) -> Array:
    """Sum (n, n) values over the samples of every two groups, (B, A, A)."""
    return np.asarray(drawn @ values @ drawn.transpose(0, 2, 1))


def _motions(yardstick: Yardstick, row: Reactions) -> tuple[Array, Array]:
    """Stack partners and reactions as whole sequences, two (n, 1, T·J·3)."""
    return yardstick.sequences(row.partners, row.times), yardstick.sequences(row.motions, row.times)
