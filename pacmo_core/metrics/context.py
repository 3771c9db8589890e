"""What all rows of an evaluation share: settings, real motion, bootstrap replicates."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pacmo_core.metrics.bootstrap import Array, bootstrap_units
from pacmo_core.metrics.controls import second_samples
from pacmo_core.metrics.diversity import n_candidates
from pacmo_core.metrics.f2id import split_into_parts
from pacmo_core.metrics.mmd import (
    PUBLISHED_BANDWIDTHS,
    as_sequence,
    mean_kernels,
    median_bandwidth,
)
from pacmo_core.metrics.plausibility import BodyJoints
from pacmo_core.metrics.reactions import Reactions, stack_motions

Codes = NDArray[np.intp]
MIN_UNITS_OF_HALVES = 4  # with two in each half, both can be resampled


@dataclass(frozen=True, kw_only=True)
class EvaluationSettings:
    """The numbers of a table's protocol.

    Parameters
    ----------
    n_samples, repeats : the paper's protocol, n samples with replacement, and the number of repeats
    bootstrap : replicates of pairs of people, or recordings, for the intervals
    second_samples : further replicates of real motion, from the training clips; as often the
        tested people are divided into halves
    n_frames : common length of motions for MMD
    n_instants, n_components : of the distances between bodies: times and principal components
    candidates : partners among which the true one is picked
    smoothing : seconds, of positions whose speed and jerk are measured
    body_radius : metres, of the capsules around bones
    contact_distance, met_distance, apart_distance : metres between joints: in contact; near enough
        to meet a contact; so far apart that a generated contact is false
    body : the joints that the metrics use
    random_seed : for all replicates
    """

    n_samples: int
    repeats: int
    bootstrap: int
    second_samples: int
    n_frames: int
    n_instants: int
    n_components: int
    candidates: int
    smoothing: float
    body_radius: float
    contact_distance: float
    met_distance: float
    apart_distance: float
    body: BodyJoints
    random_seed: int


class EvaluationContext:
    """Real reactions, second samples of real motion, and bootstrap replicates shared by all rows.

    Parameters
    ----------
    real : the real reactions of the test clips
    train : real reactions of other clips, from which the second samples are taken
    weights : (r,) quadrature weights of the features' grid
    settings : the protocol

    Raises
    ------
    ValueError
        If the two sets share a clip.
    """

    def __init__(
        self, *, real: Reactions, train: Reactions, weights: Array, settings: EvaluationSettings
    ) -> None:
        shared = sorted({*real.clips} & {*train.clips})
        if shared:
            raise ValueError(f"real and train must share no clip; both hold {shared[:3]}")
        generators = np.random.default_rng(settings.random_seed).spawn(5)
        second_sets, replicates, paper, parts, halves = generators
        self.real = real
        self.train = train
        self.weights = weights
        self.settings = settings
        self.second_sets = [
            train.take(indices)
            for indices in second_samples(
                train.clips, len(real), settings.second_samples, second_sets
            )
        ]
        unit_of = {
            (number, clip): unit
            for number, part in enumerate([real, *self.second_sets])
            for clip, unit in zip(part.clips, part.units, strict=True)
        }
        names = sorted(unit_of)
        self._column = {name: i for i, name in enumerate(names)}
        self.groups = np.array([group for group, _ in names], dtype=np.intp)
        self._units = np.unique([unit_of[name] for name in names], return_inverse=True)[1]
        samples = bootstrap_units(self.groups, self._units, settings.bootstrap, replicates)
        # (1 + bootstrap, G): the first row has every clip once and gives the plain value.
        self.counts = np.concatenate([np.ones((1, len(names))), samples])
        self.partners = self.codes(real)
        # (repeats, 2, n_samples) in [0, 1): indices of the paper's protocol, real and generated.
        self._paper = paper.random((settings.repeats, 2, settings.n_samples))
        self._parts = parts
        self.halves = self._halves(halves)

    def _halves(self, generator: np.random.Generator) -> list[tuple[Array, Array]]:
        """Divide the tested units into halves at random; count clips in replicates of each half.

        Returns
        -------
        ``second_samples`` pairs of (1 + bootstrap, G); the halves of a pair share no unit and are
        resampled each for itself. None if there are fewer than four units
        """
        tested = np.flatnonzero(self.groups == 0)
        units = np.unique(self._units[tested])
        if len(units) < MIN_UNITS_OF_HALVES:
            return []
        result = []
        for _ in range(self.settings.second_samples):
            first = generator.permutation(units)[: len(units) // 2]
            half = np.isin(self._units[tested], first).astype(np.intp)
            counts = np.zeros_like(self.counts)
            counts[0, tested] = 1
            counts[1:, tested] = bootstrap_units(
                half, self._units[tested], self.settings.bootstrap, generator
            )
            in_first = np.zeros(len(self.groups))
            in_first[tested[half == 1]] = 1
            result.append((counts * in_first, counts * (1 - in_first)))
        return result

    @property
    def n_units(self) -> int:
        """Number of tested units, which the bootstrap resamples."""
        return len(np.unique(self._units[self.groups == 0]))

    @cached_property
    def part_counts(self) -> Array:
        """Parts for the extrapolation, (repeats + bootstrap, P, G): all clips ``repeats`` times."""
        repeats = self.settings.repeats
        rows = np.concatenate([np.repeat(self.counts[:1], repeats, axis=0), self.counts[1:]])
        return split_into_parts(rows, self.groups, self._parts)

    @property
    def candidates(self) -> int:
        """Number of partners among which the true one is picked."""
        return n_candidates(self.partners, self.settings.candidates)

    def codes(self, row: Reactions, number: int = 0) -> Codes:
        """Return the column of ``counts`` of each reaction's clip, (n,).

        Parameters
        ----------
        row : reactions of clips of ``real``, or of a second sample
        number : 0 for those of ``real``, from 1 on for those of a second sample
        """
        unknown = sorted({name for name in row.clips if (number, name) not in self._column})
        if unknown:
            raise ValueError(f"clips must be those of the real reactions; {unknown[:3]} are not")
        return np.array([self._column[number, name] for name in row.clips], dtype=np.intp)

    def published_samples(self, row: Reactions) -> list[tuple[Codes, Codes]]:
        """Return the samples of each repeat of the paper's protocol: real reactions and a row."""
        sizes = np.array([[len(self.real)], [len(row)]])
        return [(i, j) for i, j in (self._paper * sizes).astype(np.intp)]

    def stacked(self, row: Reactions) -> Array:
        """Resample a row's motions to the common length, (n, n_frames, J·3)."""
        return stack_motions(row.motions, row.times, self.settings.n_frames)

    def sequences(self, motions: Sequence[NDArray[np.float32]], times: Sequence[Array]) -> Array:
        """Resample motions to the common length, as whole sequences, (n, 1, n_frames·J·3)."""
        return as_sequence(stack_motions(motions, times, self.settings.n_frames))

    @cached_property
    def real_kernels(self) -> "dict[str, RealKernels]":
        """Kernels of the real reactions for MMD-A and MMD-S, computed once for all rows."""
        stacked = self.stacked(self.real)
        shaped = {"mmd_a": stacked, "mmd_s": as_sequence(stacked)}
        return {name: RealKernels.of(motions) for name, motions in shaped.items()}


@dataclass(frozen=True)
class RealKernels:
    """Real motions (n, T, D), bandwidths (K,), the median one first, and kernels (K, n, n)."""

    motions: Array
    bandwidths: Array
    kernels: Array

    @classmethod
    def of(cls, motions: Array) -> "RealKernels":
        """Compute the kernels for the median bandwidth and the published ones."""
        bandwidths = np.array([median_bandwidth(motions), *PUBLISHED_BANDWIDTHS])
        return cls(motions, bandwidths, mean_kernels(motions, motions, bandwidths))
