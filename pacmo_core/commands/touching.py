"""What hands touch: counted in the table of ``pacmo react``, and asked for by ``--touch``."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.interaction import Motion
from pacmo_core.data.segments import segments
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.formats.inverse_kinematics import CONTACT_DISTANCE

# Metres from the axis of a trunk to the skin, where a hand touches it.
SKIN_DISTANCE = 0.18
# Reactions that are generated, at most, to find those that touch as they should.
MAX_DRAWN = 128

Joints = list[int]


class TouchName(StrEnum):
    """What should touch in a reaction."""

    right_hands = "right-hands"
    left_hands = "left-hands"
    hands = "hands"
    body = "body"
    none = "none"


@dataclass(frozen=True)
class Touch:
    """A way in which two people touch.

    Parameters
    ----------
    name : in words
    distance : metres between joints, of less than which is a touch
    pairs : joints of the reaction, and those of the partner that they touch
    """

    name: str
    distance: float
    pairs: Sequence[tuple[Joints, Joints]]

    def frames(self, partner: Motion, reaction: Motion) -> NDArray[np.bool_]:
        """Return in which frames of motions ``(T, J, 3)`` they touch, ``(T,)``."""
        return _gaps(partner, reaction, self.pairs) < self.distance


def touches(skeleton: Skeleton) -> dict[str, Touch]:
    """Return the ways in which hands touch, by short names; none of a skeleton without hands."""
    hands = _hands(skeleton)
    if not hands:
        return {}
    hand = [joint for joints in hands.values() for joint in joints]
    body = [joint for joint in range(len(skeleton.joints)) if joint not in hand]
    found = {
        f"{side}-hands": Touch(f"{side} hand to {side}", CONTACT_DISTANCE, [(joints, joints)])
        for side, joints in hands.items()
    }
    if len(hands) == 2:
        left, right = hands.values()
        pairs = [(left, right), (right, left)]
        found["left-to-right"] = Touch("a left hand to a right", CONTACT_DISTANCE, pairs)
    found["body"] = Touch("a hand to the partner's body", SKIN_DISTANCE, [(hand, body)])
    found["by-partner"] = Touch("the partner's hand to the body", SKIN_DISTANCE, [(body, hand)])
    return found


def touches_asked(name: TouchName, skeleton: Skeleton) -> list[Touch]:
    """Return the touches of which one is asked for, or none of which.

    Raises
    ------
    ValueError
        If the skeleton has not the hands.
    """
    every = touches(skeleton)
    asked = {
        TouchName.hands: ["left-hands", "right-hands", "left-to-right"],
        TouchName.body: ["body", "by-partner"],
        TouchName.none: list(every),
    }.get(name, [name.value])
    if not every or not set(asked) <= set(every):
        raise ValueError(f"{name}: wanted a skeleton with a left and a right hand")
    return [every[one] for one in asked]


def is_as_asked(name: TouchName, asked: Sequence[Touch], partner: Motion, reaction: Motion) -> bool:
    """Return whether one of the touches is in a frame; of ``none``, whether in no frame.

    Parameters
    ----------
    asked : of ``touches_asked``
    partner, reaction : (T, J, 3) metres
    """
    is_touched = any(touch.frames(partner, reaction).any() for touch in asked)
    return is_touched != (name == TouchName.none)


def draw_until(
    draw: Callable[[], Motion],
    is_wanted: Callable[[Motion], bool],
    count: int,
) -> tuple[list[Motion], int]:
    """Draw motions until ``count`` of them are wanted, ``MAX_DRAWN`` at most.

    What is kept has the distribution of the motions that are drawn, given that they are wanted
    (rejection sampling).

    Returns
    -------
    The wanted ones, ``count`` or fewer, and how many were drawn
    """
    kept: list[Motion] = []
    drawn = 0
    while len(kept) < count and drawn < MAX_DRAWN:
        motion = draw()
        drawn += 1
        if is_wanted(motion):
            kept.append(motion)
    return kept, drawn


def least_gap(partner: Motion, reaction: Motion) -> float:
    """Return the least distance of any two joints of motions ``(T, J, 3)``, in metres."""
    every = list(range(partner.shape[1]))
    return float(_gaps(partner, reaction, [(every, every)]).min())


def _hands(skeleton: Skeleton) -> dict[str, Joints]:
    """Return the joints of each hand, from the wrist on, by its side."""
    hands: dict[str, Joints] = {}
    for end, of in zip(skeleton.bones[:, 1].tolist(), segments(skeleton), strict=True):
        if of.part == "arm" and of.kind != "upper_arm":
            hands.setdefault(of.name.partition("_")[0], []).append(end)
    return hands


def _gaps(
    partner: Motion, reaction: Motion, pairs: Sequence[tuple[Joints, Joints]]
) -> NDArray[np.float64]:
    """Return the least distance of the reaction's joints from the partner's, ``(T,)`` metres."""
    differences = (
        reaction[:, i] - partner[:, j] for own, others in pairs for i in own for j in others
    )
    gaps: NDArray[np.float64] = reduce(
        np.minimum, (np.linalg.norm(difference, axis=-1) for difference in differences)
    )
    return gaps
