"""Interactions as functions of normalised time, seen from the partner."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from pacmo_core.data.interaction import Interaction, Motion
from pacmo_core.data.transforms import body_frame
from pacmo_core.operators.encode import Spline


@dataclass(frozen=True)
class Condition:
    """What a reaction answers.

    Parameters
    ----------
    partner : (B, T, 3 J) float32, metres, in the partner's first frame
    log_duration : (B,) float32, logarithm of seconds
    action : (B,) int64, numbers of action labels; zeros where labels are no condition
    """

    partner: Tensor
    log_duration: Tensor
    action: Tensor


@dataclass(frozen=True)
class MotionPairs:
    """Partner and reaction on N evenly spaced instants of [0, 1], in the partner's first frame.

    Parameters
    ----------
    partner, reaction : (B, N, 3 J) float32, metres
    log_duration : (B,) float32, logarithm of seconds
    action : (B,) int64, numbers of action labels; zeros where no label is a condition
    """

    partner: Tensor
    reaction: Tensor
    log_duration: Tensor
    action: Tensor

    def __len__(self) -> int:
        return len(self.partner)

    def __getitem__(self, rows: Tensor | slice) -> "MotionPairs":
        return self._each(lambda part: part[rows])

    @property
    def condition(self) -> Condition:
        """All but the reaction."""
        return Condition(self.partner, self.log_duration, self.action)

    def repeat(self, n: int) -> "MotionPairs":
        """Set n copies one behind the other."""
        return self._each(lambda part: part.repeat(n, *[1] * (part.ndim - 1)))

    def to(self, device: str | torch.device) -> "MotionPairs":
        """Move to a device."""
        return self._each(lambda part: part.to(device))

    def _each(self, change: Callable[[Tensor], Tensor]) -> "MotionPairs":
        return MotionPairs(*map(change, vars(self).values()))


def encode(
    interactions: Sequence[Interaction], n_points: int, action: Tensor | None = None
) -> MotionPairs:
    """Sample each interaction on one grid: ``person_a`` is the partner, ``person_b`` reacts.

    Parameters
    ----------
    interactions : B of them
    n_points : N
    action : (B,) int64, numbers of their labels, if labels are a condition

    Raises
    ------
    ValueError
        If there are none, or their skeletons differ.
    """
    common_skeleton(interactions)
    sampled = [_sample(interaction, n_points) for interaction in interactions]
    # Copied into torch's own memory: its products round by alignment, and NumPy's varies.
    return MotionPairs(
        partner=torch.tensor(np.stack([partner for partner, _ in sampled])),
        reaction=torch.tensor(np.stack([reaction for _, reaction in sampled])),
        log_duration=torch.tensor([np.log(i.duration) for i in interactions], dtype=torch.float32),
        action=torch.zeros(len(interactions), dtype=torch.long) if action is None else action,
    )


def both_sides(interactions: Sequence[Interaction], *, swap: bool) -> list[Interaction]:
    """List the interactions and, if asked, each with its people exchanged (PaCMO, 3.1)."""
    return [*interactions, *(i.swapped() for i in interactions if swap)]


def common_skeleton(interactions: Sequence[Interaction]) -> None:
    """Refuse an empty list, and two bodies of different joints."""
    skeletons = {interaction.skeleton for interaction in interactions}
    if len(skeletons) != 1:
        names = sorted(skeleton.name for skeleton in skeletons)
        raise ValueError(f"interactions must share one skeleton; got {names or 'no interaction'}")


def _sample(interaction: Interaction, n_points: int) -> tuple[Motion, Motion]:
    frame = body_frame(interaction.person_a, interaction.skeleton)
    partner, reaction = (
        Spline(interaction.times, frame.to_local(motion).reshape(len(motion), -1))
        .on_grid(n_points)
        .astype(np.float32)
        for motion in (interaction.person_a, interaction.person_b)
    )
    return partner, reaction
