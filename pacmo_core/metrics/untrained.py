"""Reactions without a model: the mean training reaction, and a copy of the nearest neighbour's.

A trained model is to be better than both. Only training clips are copied, each in both directions;
every motion is seen from the first pose of its partner, at normalised time.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.interaction import Interaction, Motion
from pacmo_core.data.transforms import Frame, body_frame
from pacmo_core.operators.spline import Spline

Array = NDArray[np.float64]


@dataclass(frozen=True)
class TrainingReactions:
    """Training clips in both directions, from which reactions are taken.

    Parameters
    ----------
    interactions : n clips, ``person_a`` the partner
    partners, reactions : (n, N, J, 3) metres, from the partner's first pose, at N times in [0, 1]
    """

    interactions: Sequence[Interaction]
    partners: Array
    reactions: Array

    @classmethod
    def of(cls, clips: Sequence[Interaction], n_points: int) -> "TrainingReactions":
        """Sample training clips, each in both directions, at N times.

        Raises
        ------
        ValueError
            If there are no clips.
        """
        if not clips:
            raise ValueError("wanted training clips, got none")
        interactions = [*clips, *(clip.swapped() for clip in clips)]
        grid = np.linspace(0, 1, n_points)
        frames = [_frame(clip) for clip in interactions]
        partners, reactions = (
            np.stack(
                [
                    _resample(clip, frame.to_local(getattr(clip, person)), grid)
                    for clip, frame in zip(interactions, frames, strict=True)
                ]
            )
            for person in ("person_a", "person_b")
        )
        return cls(interactions, partners, reactions)

    def mean(self, test: Interaction) -> Motion:
        """Return the mean reaction, at the times and in the place of a test clip, (T, J, 3)."""
        grid = np.linspace(0, 1, self.reactions.shape[1])
        mean = Spline(grid, self.reactions.mean(axis=0))(_normalised(test))
        return _frame(test).to_world(mean.astype(np.float32))

    def nearest(self, test: Interaction) -> Motion:
        """Return the reaction of the nearest training partner, re-timed, (T, J, 3)."""
        return np.asarray(self.several_nearest(test, 1)[0])

    def several_nearest(self, test: Interaction, n: int) -> Motion:
        """Return the reactions of the n nearest training partners, re-timed, (n, T, J, 3).

        The distance of two partners is the root mean square, over joints and normalised time, of
        the distance of their joints, in metres; of equally near ones the first is taken. The
        reaction of the test clip is not looked at, and a training clip is no neighbour of its own.
        """
        grid = np.linspace(0, 1, self.partners.shape[1])
        partner = _resample(test, _frame(test).to_local(test.person_a), grid)
        squared = ((self.partners - partner) ** 2).sum(axis=-1).mean(axis=(1, 2))
        own = [
            any(clip.person_a is motion for motion in (test.person_a, test.person_b))
            for clip in self.interactions
        ]
        squared[own] = np.inf
        found = []
        for row in np.argsort(squared, kind="stable")[:n].tolist():
            clip = self.interactions[row]
            reaction = _resample(clip, _frame(clip).to_local(clip.person_b), _normalised(test))
            found.append(_frame(test).to_world(reaction.astype(np.float32)))
        return np.stack(found)


def _frame(clip: Interaction) -> Frame:
    return body_frame(clip.person_a, clip.skeleton)


def _resample(clip: Interaction, motion: Motion, at: Array) -> Array:
    """Sample a motion of a clip at normalised times: (N, J, 3)."""
    return Spline(_normalised(clip), motion)(at)


def _normalised(clip: Interaction) -> Array:
    """Return the times of a clip's frames in [0, 1]."""
    return np.asarray((clip.times - clip.times[0]) / clip.duration)
