"""Intervals: how far a metric may lie from its value because clips are few.

A bootstrap draws clips, not samples: the two people of a clip, and all stretches that share its
name, come or stay away together (cluster bootstrap; Davison and Hinkley 1997, section 3.8). The
same draws serve every row and every metric, so two rows can be compared draw by draw.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Interval:
    """A metric on all samples, and the bounds of its interval."""

    mean: float
    low: float
    high: float


@dataclass(frozen=True)
class Estimate:
    """A metric on all samples, and on each of B bootstrap draws of the clips.

    Parameters
    ----------
    plain : on all samples
    resampled : (B,), one a draw
    """

    plain: float
    resampled: Array

    def minus(self, other: "Estimate") -> "Estimate":
        """Subtract another row's metric, draw by draw: a paired difference."""
        if self.resampled.shape != other.resampled.shape:
            raise ValueError(
                "a paired difference wants the same draws; "
                f"got {len(self.resampled)} and {len(other.resampled)}"
            )
        return Estimate(self.plain - other.plain, self.resampled - other.resampled)


def interval(estimate: Estimate, confidence: float, *, least: float = -np.inf) -> Interval:
    """Turn the bootstrap's draws into an interval about the value on all samples.

    With θ̂ the plain value and θ* the draws, the interval is θ̂ − (q(θ*) − mean θ*), q the two outer
    quantiles: the basic bootstrap (Davison and Hinkley 1997, section 5.2) of the draws after their
    mean is moved to θ̂. The move matters for F²ID and published MMD: a draw holds some clips
    twice, which adds a bias about as large as that of the plain value itself, and would lift
    every draw above it. So the interval is for the mean of the metric *at this number of
    clips*, small-sample bias included; a floor must be of the same size to be compared with.

    Held at a stated 95 % (200 trials each; 20 and 40 clips of two samples, 3 dimensions): 0.92 and
    0.89 for paired sets, 0.97 and 0.99 for two sets of one law. Without the move the basic
    interval held 0.91, 0.87, 0.62, 0.62.

    Parameters
    ----------
    estimate : the metric and its draws
    confidence : in (0, 1)
    least : the smallest value that the metric can take, at which the interval is cut
    """
    if not 0 < confidence < 1:
        raise ValueError(f"confidence must lie in (0, 1); got {confidence}")
    spread = estimate.resampled - estimate.resampled.mean()
    high, low = np.quantile(spread, [(1 - confidence) / 2, (1 + confidence) / 2])
    mean = estimate.plain
    return Interval(mean, max(mean - float(low), least), max(mean - float(high), least))


def difference(first: Estimate, second: Estimate, confidence: float) -> Interval:
    """Give the interval of ``first`` minus ``second``, their draws paired.

    Two rows differ when this interval excludes zero; whether their own intervals overlap says
    little.
    """
    return interval(first.minus(second), confidence)


def repeated(values: Array) -> Interval:
    """Report repeats of the paper's protocol: their mean, the smallest and the largest.

    Drawing 1,000 with replacement from few samples, five times, shows the noise of drawing alone;
    this is no confidence interval for the metric.
    """
    return Interval(float(values.mean()), float(values.min()), float(values.max()))


def resample_clips(groups: NDArray[np.intp], n_draws: int, generator: np.random.Generator) -> Array:
    """Draw clips with replacement, each group (say, test and training clips) for itself.

    Parameters
    ----------
    groups : (G,) int, the group of each clip
    n_draws : B

    Returns
    -------
    (B, G) how often each draw took each clip; every draw has at least two clips of each group
    """
    counts = np.zeros((n_draws, len(groups)))
    for group in np.unique(groups):
        members = np.flatnonzero(groups == group)
        if len(members) < 2:
            raise ValueError(f"a bootstrap wants at least 2 clips; group {group} has one")
        share = np.full(len(members), 1 / len(members))
        for draw in counts:
            # A draw of one clip alone has no spread to measure; from 8 clips on it never happens.
            while np.count_nonzero(draw[members]) < 2:
                draw[members] = generator.multinomial(len(members), share)
    return counts
