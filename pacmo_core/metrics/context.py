"""What all rows of an evaluation share: settings, real motion, bootstrap replicates."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pacmo_core.metrics.bootstrap import MIN_UNITS, Array, bootstrap_units
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
MIN_UNITS_OF_HALVES = 2 * MIN_UNITS  # for replicates of the halves
SECOND_CLIPS = 4  # in each replicate of a second sample, which is divided into quarters


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


@dataclass(frozen=True)
class _UnitsOf:
    """The units of a set of reactions.

    Parameters
    ----------
    n_units : U, of all reactions
    of_column : (C,) int, the unit of the clip of each column
    """

    n_units: int
    of_column: Codes

    @classmethod
    def columns(cls, reactions: Reactions, clips: Sequence[str]) -> "_UnitsOf":
        """Return the units of reactions, and that of each column's clip."""
        names, codes = np.unique(reactions.units, return_inverse=True)
        unit_of = dict(zip(reactions.clips, codes, strict=True))
        return cls(len(names), np.array([unit_of[clip] for clip in clips], dtype=np.intp))

    def sizes(self, selected: NDArray[np.bool_]) -> Codes:
        """Count the selected columns of each unit, (U,)."""
        return np.bincount(self.of_column[selected], minlength=self.n_units)


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
        groups = enumerate([real, *self.second_sets])
        names = sorted({(number, clip) for number, part in groups for clip in part.clips})
        self._column = {name: i for i, name in enumerate(names)}
        self.groups = np.array([group for group, _ in names], dtype=np.intp)
        self._tested = _UnitsOf.columns(real, [clip for group, clip in names if group == 0])
        self._trained = _UnitsOf.columns(train, [clip for group, clip in names if group > 0])
        divisions = self._divisions(halves)
        # (1 + B, G): the first row has every clip once and gives the plain value; B is 0 where
        # there are too few units.
        self.counts = np.concatenate(
            [np.ones((1, len(names))), self._replicates(divisions, replicates)]
        )
        self.partners = self.codes(real)
        # (repeats, 2, n_samples) in [0, 1): indices of the paper's protocol, real and generated.
        self._paper = paper.random((settings.repeats, 2, settings.n_samples))
        self._parts = parts
        self.halves = self._halves(divisions)

    def _divisions(self, generator: np.random.Generator) -> NDArray[np.bool_]:
        """Divide the tested units into halves at random.

        Returns
        -------
        (K, U) whether a unit is in the first half; none if there are fewer than four units
        """
        n_divisions = self.settings.second_samples if self.n_units >= MIN_UNITS else 0
        result = np.zeros((n_divisions, self.n_units), dtype=np.bool_)
        for division in result:
            division[generator.permutation(self.n_units)[: self.n_units // 2]] = True
        return result

    def _replicates(self, divisions: NDArray[np.bool_], generator: np.random.Generator) -> Array:
        """Count clips in replicates, (B, G); tested units and training units are drawn once each.

        A second sample counts its clips by the draw of the training units, so that second samples
        with common clips share them in every replicate.
        """
        numbers = range(1, 1 + len(self.second_sets))
        second_sets = np.array(
            [self._trained.sizes(self.groups[self.groups > 0] == number) for number in numbers]
        )
        fewest = min(self.n_units, *(second_sets > 0).sum(axis=1))
        if fewest < MIN_UNITS:
            return np.zeros((0, len(self.groups)))
        n = self.settings.bootstrap
        whole = np.ones((1, self.n_units), dtype=np.intp)
        if self.n_units >= MIN_UNITS_OF_HALVES:
            # Neither half of a division is empty in any replicate.
            both = np.concatenate([divisions, ~divisions]).astype(np.intp)
            tested = bootstrap_units(both, n, generator, least_units=1)
        else:
            tested = bootstrap_units(whole, n, generator)
        trained = bootstrap_units(second_sets, n, generator, least_clips=SECOND_CLIPS)
        # Columns are sorted by group, the tested clips first.
        return np.concatenate(
            [tested[:, self._tested.of_column], trained[:, self._trained.of_column]], axis=1
        )

    def _halves(self, divisions: NDArray[np.bool_]) -> list[tuple[Array, Array]]:
        """Count the clips of each half in every replicate.

        Returns
        -------
        pairs of (1 + bootstrap, G), or of (1, G) where the units are too few for replicates of
        halves; the halves of a pair share no unit, and together have the tested clips of ``counts``
        """
        counts = self.counts if self.n_units >= MIN_UNITS_OF_HALVES else self.counts[:1]
        tested = self.groups == 0
        result = []
        for division in divisions:
            in_first, in_second = np.zeros((2, len(self.groups)))
            in_first[tested] = division[self._tested.of_column]
            in_second[tested] = ~division[self._tested.of_column]
            result.append((counts * in_first, counts * in_second))
        return result

    @property
    def n_units(self) -> int:
        """Number of tested units, which the bootstrap resamples."""
        return self._tested.n_units

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
