"""What every row of one table is measured with: real motion, draws of clips, kernels."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pacmo_core.metrics.floors import draw_by_clip
from pacmo_core.metrics.intervals import Array, resample_clips
from pacmo_core.metrics.mmd import (
    PUBLISHED_BANDWIDTHS,
    as_sequence,
    mean_kernels,
    median_bandwidth,
)
from pacmo_core.metrics.reactions import Reactions
from pacmo_core.metrics.resampling import stack_motions


@dataclass(frozen=True, kw_only=True)
class Settings:
    """The numbers of a table's protocol.

    Parameters
    ----------
    n_samples, repeats : the paper's protocol, n drawn with replacement so many times
    bootstrap : draws of clips for the intervals
    confidence : of the intervals, in (0, 1)
    n_frames : common length of motions for MMD
    root : index of the root joint
    random_seed : for all draws
    """

    n_samples: int
    repeats: int
    bootstrap: int
    confidence: float
    n_frames: int
    root: int
    random_seed: int


class Yardstick:
    """Real reactions, a second draw of real motion, and draws of clips shared by all rows.

    Parameters
    ----------
    real : the real reactions of the test clips
    train : real reactions of other clips, from which the second draw is taken
    weights : (r,) quadrature weights of the features' grid
    settings : the protocol

    Raises
    ------
    ValueError
        If the two sets share a clip, or ``train`` is the smaller.
    """

    def __init__(
        self, *, real: Reactions, train: Reactions, weights: Array, settings: Settings
    ) -> None:
        shared = sorted({*real.clips} & {*train.clips})
        if shared:
            raise ValueError(f"real and train must share no clip; both hold {shared[:3]}")
        clips, draws, paper = np.random.default_rng(settings.random_seed).spawn(3)
        self.real = real
        self.weights = weights
        self.settings = settings
        self.second = train.take(draw_by_clip(train.clips, len(real), clips))
        names = sorted({*real.clips}) + sorted({*self.second.clips})
        self._code = {name: i for i, name in enumerate(names)}
        groups = np.array([name not in {*real.clips} for name in names], dtype=np.intp)
        drawn = resample_clips(groups, settings.bootstrap, draws)
        # (1 + bootstrap, G): the first row has every clip once and gives the plain value.
        self.counts = np.concatenate([np.ones((1, len(names))), drawn])
        shape = (2, settings.repeats, settings.n_samples)
        # The paper's draws: of the real reactions, and of any row's.
        self.real_drawn, self.row_drawn = paper.integers(len(real), size=shape)

    def codes(self, row: Reactions) -> NDArray[np.intp]:
        """Look up the column of ``counts`` of each reaction's clip, (n,)."""
        unknown = sorted({*row.clips} - {*self._code})
        if unknown:
            raise ValueError(f"clips must be those of the real reactions; {unknown[:3]} are not")
        return np.array([self._code[name] for name in row.clips], dtype=np.intp)

    def stacked(self, row: Reactions) -> Array:
        """Resample a row's motions to the common length, (n, n_frames, J·3)."""
        return stack_motions(row.motions, row.times, self.settings.n_frames)

    @cached_property
    def real_kernels(self) -> "dict[str, RealKernels]":
        """What MMD-A and MMD-S need of the real reactions, computed once for all rows."""
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
        """Choose the median bandwidth beside the published ones."""
        bandwidths = np.array([median_bandwidth(motions), *PUBLISHED_BANDWIDTHS])
        return cls(motions, bandwidths, mean_kernels(motions, motions, bandwidths))
