"""F²ID of a row in one kind of coordinates: against the tested real motion, and second draws.

``between`` is to the real reactions tested. A row that answers the very partners tested shares
their sampling error, so this may lie below what two samples of real motion are apart. So a row is
also held against ``second`` draws of real motion, of other people's or other recordings' clips:
there, real pairs have a score of their own, and what a row has beyond it is its ``excess``.
"""

from functools import cached_property

import numpy as np

from pacmo_core.metrics.extrapolation import extrapolate
from pacmo_core.metrics.gaussians import Codes, Gaussians, distances, fit_gaussians
from pacmo_core.metrics.intervals import Array
from pacmo_core.metrics.yardstick import Yardstick


class Laws:
    """Gaussian laws of the real motion, fitted once for all rows.

    Parameters
    ----------
    real : (n, D) coordinates of the real reactions tested
    seconds : (m, D) of each second draw
    yardstick : whose draws these are
    """

    def __init__(self, real: Array, seconds: list[Array], yardstick: Yardstick) -> None:
        self._coordinates = real, seconds
        self._yardstick = yardstick
        numbered = enumerate(zip(seconds, yardstick.seconds, strict=True), start=1)
        self._second_codes = [yardstick.codes(second, k) for k, (_, second) in numbered]

    def between(self, row: Array, codes: Codes) -> Array:
        """Measure F²ID to the real reactions tested, (1 + bootstrap,)."""
        return distances(self._real, fit_gaussians(row, codes, self._yardstick.counts))

    def second(self, row: Array, codes: Codes) -> Array:
        """Average F²ID to the second draws, (1 + bootstrap,)."""
        law = fit_gaussians(row, codes, self._yardstick.counts)
        return np.asarray(np.mean([distances(law, second) for second in self._seconds], axis=0))

    @cached_property
    def floor(self) -> Array:
        """Average F²ID between the real reactions tested and the second draws."""
        return self.second(self._coordinates[0], self._yardstick.partners)

    def infinity(self, row: Array, codes: Codes) -> Array:
        """Extrapolate F²ID to infinitely many samples of both, (1 + bootstrap,)."""
        law = fit_gaussians(row, codes, self._parts)
        return self._extrapolated(distances(self._real_parts, law))

    @cached_property
    def floor_infinity(self) -> Array:
        """Extrapolate the floor: what remains is that test and training clips differ."""
        real = self._real_parts
        found = [
            distances(real, fit_gaussians(x, codes, self._parts))
            for x, codes in zip(self._coordinates[1], self._second_codes, strict=True)
        ]
        return self._extrapolated(np.mean(found, axis=0))

    def _extrapolated(self, values: Array) -> Array:
        """Average what was dealt several times from all clips, and put it first."""
        parts = self._yardstick.part_counts
        found = extrapolate(values.reshape(parts.shape[:2]))
        repeats = self._yardstick.settings.repeats
        return np.concatenate([[found[:repeats].mean()], found[repeats:]])

    @property
    def _parts(self) -> Array:
        parts = self._yardstick.part_counts
        return parts.reshape(-1, parts.shape[-1])

    @cached_property
    def _real(self) -> Gaussians:
        return fit_gaussians(self._coordinates[0], self._yardstick.partners, self._yardstick.counts)

    @cached_property
    def _real_parts(self) -> Gaussians:
        return fit_gaussians(self._coordinates[0], self._yardstick.partners, self._parts)

    @cached_property
    def _seconds(self) -> list[Gaussians]:
        pairs = zip(self._coordinates[1], self._second_codes, strict=True)
        return [fit_gaussians(x, codes, self._yardstick.counts) for x, codes in pairs]
