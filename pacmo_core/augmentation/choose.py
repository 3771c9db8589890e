"""Which clips are varied: those in which the two are nearest, of as many acts as there are."""

from collections.abc import Sequence
from dataclasses import dataclass

from pacmo_core.data.interaction import Interaction, joint_distances


@dataclass(frozen=True)
class Candidate:
    """A clip that may be varied.

    Parameters
    ----------
    clip, sequence, action : as in its facts
    nearness : of the two people; see ``nearness_of``
    """

    clip: str
    sequence: str
    action: str
    nearness: float


def nearness_of(interaction: Interaction, near: float) -> float:
    """Count pairs of joints, one of either person, nearer than ``near`` metres: mean of frames."""
    return float((joint_distances(interaction) < near).sum() / len(interaction.times))


def choose(
    candidates: Sequence[Candidate], *, of_each_sequence: int | None, most: int | None
) -> list[str]:
    """Choose clips: the nearest of each sequence, and of these one an act before a second of any.

    Parameters
    ----------
    of_each_sequence, most : at most; None for all

    Returns
    -------
    names, sorted
    """
    nearest = sorted(candidates, key=lambda c: (-c.nearness, c.clip))
    first = _turns([c.sequence for c in nearest])
    kept = [
        candidate
        for candidate, turn in zip(nearest, first, strict=True)
        if of_each_sequence is None or turn < of_each_sequence
    ]
    turns = _turns([c.action for c in kept])
    order = sorted(range(len(kept)), key=lambda i: (turns[i], i))
    return sorted(kept[i].clip for i in order[:most])


def _turns(names: Sequence[str]) -> list[int]:
    """Say how often each name was named before."""
    seen: dict[str, int] = {}
    turns = []
    for name in names:
        turns.append(seen.get(name, 0))
        seen[name] = turns[-1] + 1
    return turns
