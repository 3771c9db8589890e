"""The data of one row of a table: reactions, partners, features; resampling to one length."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Reactions:
    """Reactions to n partners, real or generated, with their features.

    Parameters
    ----------
    features : (n, C, r), the features of (partner, reaction) on the common grid
    motions : n reactions (T_i, J, 3), metres
    partners : n motions of the partners, (T_i, J, 3), metres, at the same times
    times : n times (T_i,), seconds, strictly increasing
    clips : the clip in which each reaction was recorded, or for which it was generated
    embedded : (2, n, E) unit vectors of a matcher, of the partners and of the reactions
    units : of each clip, what the bootstrap resamples: its pair of people, or its recording
    actions : the action of each partner's clip
    further : (S, n, C, r), features of S further reactions to each partner; S may be 0
    further_motions : S lists of n motions, those reactions

    Raises
    ------
    ValueError
        If numbers or shapes do not agree, or a value is not finite.
    """

    features: NDArray[np.float64]
    motions: Sequence[NDArray[np.float32]]
    partners: Sequence[NDArray[np.float32]]
    times: Sequence[NDArray[np.float64]]
    clips: Sequence[str]
    embedded: NDArray[np.float64]
    units: Sequence[str]
    actions: Sequence[str]
    further: NDArray[np.float64]
    further_motions: Sequence[Sequence[NDArray[np.float32]]]

    def __post_init__(self) -> None:
        parts = (self.motions, self.partners, self.times, self.clips, self.units, self.actions)
        numbers = [len(part) for part in parts]
        if self.features.ndim != 3 or {*numbers} != {len(self.features)} or not numbers[0]:
            raise ValueError(
                "wanted features (n, C, r) and n > 0 motions, partners, times, clips, units, "
                f"actions; got {self.features.shape}, {numbers}"
            )
        if self.embedded.ndim != 3 or self.embedded.shape[:2] != (2, len(self)):
            raise ValueError(f"embedded must be (2, {len(self)}, E); got {self.embedded.shape}")
        if self.further.ndim != 4 or self.further.shape[1:] != self.features.shape:
            raise ValueError(
                f"further features must be (S, {', '.join(map(str, self.features.shape))}); "
                f"got {self.further.shape}"
            )
        if [len(motions) for motions in self.further_motions] != [len(self)] * len(self.further):
            raise ValueError(
                f"further motions must be {len(self.further)} lists of {len(self)}; "
                f"got {[len(motions) for motions in self.further_motions]}"
            )
        if not np.isfinite(self.features).all():
            bad = int(np.argwhere(~np.isfinite(self.features))[0, 0])
            raise ValueError(f"features must be finite; those of sample {bad} are not")
        for i in range(len(self)):
            self._check(i)

    def __len__(self) -> int:
        """Return the number of reactions."""
        return len(self.features)

    def take(self, indices: NDArray[np.intp]) -> "Reactions":
        """Select by index, in that order."""
        return Reactions(
            features=self.features[indices],
            motions=[self.motions[i] for i in indices],
            partners=[self.partners[i] for i in indices],
            times=[self.times[i] for i in indices],
            clips=[self.clips[i] for i in indices],
            embedded=self.embedded[:, indices],
            units=[self.units[i] for i in indices],
            actions=[self.actions[i] for i in indices],
            further=self.further[:, indices],
            further_motions=[[motions[i] for i in indices] for motions in self.further_motions],
        )

    def _check(self, i: int) -> None:
        motion, partner, times = self.motions[i], self.partners[i], self.times[i]
        if motion.ndim != 3 or motion.shape != partner.shape or times.shape != motion.shape[:1]:
            raise ValueError(
                f"sample {i}: wanted motion and partner (T, J, 3) and times (T,); "
                f"got {motion.shape}, {partner.shape}, {times.shape}"
            )
        if not np.isfinite(motion).all():
            raise ValueError(f"sample {i} (clip {self.clips[i]}): its motion is not finite")


def to_length(
    motion: NDArray[np.float32], times: NDArray[np.float64], n_frames: int
) -> NDArray[np.float64]:
    """Resample a motion to equally spaced frames, linearly.

    A spline would overshoot at the jumps of noisy captures.

    Parameters
    ----------
    motion : (T, J, 3) metres
    times : (T,) seconds, strictly increasing
    n_frames : at least 2

    Returns
    -------
    (n_frames, J, 3) float64, metres
    """
    if len(times) != len(motion) or n_frames < 2:
        raise ValueError(
            f"wanted one time per frame and at least 2 frames; got {len(times)} times, "
            f"{len(motion)} frames, n_frames {n_frames}"
        )
    at = np.linspace(times[0], times[-1], n_frames)
    after = np.searchsorted(times, at, side="left").clip(1, len(times) - 1)
    fraction = (at - times[after - 1]) / (times[after] - times[after - 1])
    fraction = fraction[:, None, None]
    values = motion.astype(np.float64)
    return np.asarray((1 - fraction) * values[after - 1] + fraction * values[after])


def stack_motions(
    motions: Sequence[NDArray[np.float32]], times: Sequence[NDArray[np.float64]], n_frames: int
) -> NDArray[np.float64]:
    """Resample n motions into one array (n, n_frames, J·3), metres."""
    pairs = zip(motions, times, strict=True)
    return np.stack([to_length(m, t, n_frames).reshape(n_frames, -1) for m, t in pairs])
