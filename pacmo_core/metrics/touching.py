"""What hands touch: counted in the table of ``pacmo react``, and asked for by its ``--touch``."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.interaction import Motion
from pacmo_core.data.segments import segments
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.formats.inverse_kinematics import CONTACT_DISTANCE

# Metres from the axis of a trunk or a head to the skin, where a hand touches it.
SKIN_DISTANCE = 0.18
MIN_SECONDS = 0.1  # in which people touch, of the whole motion
_LIMBS = ("upper_arm", "thigh", "shin", "foot", "toes")
# Reactions that are generated, at most, to find those that touch as they should.
MAX_DRAWN = 128

Joints = list[int]


class TouchName(StrEnum):
    """What should touch in a reaction: hands, the other's body, or neither."""

    right_hands = "right-hands"
    left_hands = "left-hands"
    hands = "hands"
    embrace = "embrace"  # a hand of each is on the other's body
    body = "body"  # a hand of the reaction on the partner's body
    by_partner = "by-partner"  # a hand of the partner on the reaction's body
    no_hands = "no-hands"


@dataclass(frozen=True)
class Touch:
    """A way in which two people touch.

    Parameters
    ----------
    name : in words
    pairs : joints of the reaction, those of the partner that they touch, and metres between joints
        of less than which is a touch
    """

    name: str
    pairs: Sequence[tuple[Joints, Joints, float]]

    def frames(self, partner: Motion, reaction: Motion) -> NDArray[np.bool_]:
        """Return in which frames of motions ``(T, J, 3)`` they touch, ``(T,)``."""
        found = [
            _gaps(partner, reaction, own, others) < distance for own, others, distance in self.pairs
        ]
        touching: NDArray[np.bool_] = np.any(found, axis=0)
        return touching


def touches(skeleton: Skeleton) -> dict[str, Touch]:
    """Return the ways in which hands touch, by short names; none of a skeleton without hands."""
    hands = _hands(skeleton)
    if not hands:
        return {}
    hand = [joint for joints in hands.values() for joint in joints]
    limbs = _ends(skeleton, _LIMBS)
    trunk = [joint for joint in range(len(skeleton.joints)) if joint not in (*hand, *limbs)]
    body = [(trunk, SKIN_DISTANCE), *([(limbs, CONTACT_DISTANCE)] if limbs else [])]
    found = {
        f"{side}-hands": Touch(f"{side} hand to {side}", [(joints, joints, CONTACT_DISTANCE)])
        for side, joints in hands.items()
    }
    if len(hands) == 2:
        left, right = hands.values()
        pairs = [(left, right, CONTACT_DISTANCE), (right, left, CONTACT_DISTANCE)]
        found["left-to-right"] = Touch("a left hand to a right", pairs)
    found["body"] = Touch("a hand to the partner's body", [(hand, *of) for of in body])
    of_partner = [(joints, hand, distance) for joints, distance in body]
    found["by-partner"] = Touch("the partner's hand to the body", of_partner)
    return found


def has_hands(skeleton: Skeleton) -> bool:
    """Whether a skeleton has a left and a right hand."""
    return len(_hands(skeleton)) == 2


def check_hands(name: TouchName, skeleton: Skeleton) -> None:
    """Refuse to ask for a touch of a skeleton that has not both hands.

    Raises
    ------
    ValueError
        With the name of the touch.
    """
    if not has_hands(skeleton):
        raise ValueError(f"{name}: wanted a skeleton with a left and a right hand")


def is_as_asked(
    name: TouchName,
    skeleton: Skeleton,
    times: NDArray[np.float64],
    partner: Motion,
    reaction: Motion,
) -> bool:
    """Return whether two people touch as asked for ``MIN_SECONDS``; of ``no-hands``: in no frame.

    Parameters
    ----------
    skeleton : with two hands, of both
    times : (T,) seconds
    partner, reaction : (T, J, 3) metres
    """
    found = {key: touch.frames(partner, reaction) for key, touch in touches(skeleton).items()}
    of_hands = found["left-hands"] | found["right-hands"] | found["left-to-right"]
    if name == TouchName.no_hands:
        return not (of_hands | found["body"] | found["by-partner"]).any()
    found |= {"hands": of_hands, "embrace": found["body"] & found["by-partner"]}
    # A hand that passes by touches too: for fewer frames.
    return int(found[name.value].sum()) >= max(
        1, round(MIN_SECONDS / float(np.median(np.diff(times))))
    )


def draw_until(
    draw: Callable[[], Motion], tests: Mapping[str, Callable[[Motion], bool]], count: int
) -> tuple[list[Motion], int, dict[str, int]]:
    """Draw motions until ``count`` of them pass every test, ``MAX_DRAWN`` at most.

    What is kept has the distribution of the motions that are drawn, given that they pass
    (rejection sampling).

    Returns
    -------
    Those that pass, ``count`` or fewer, how many were drawn, and how many pass each test
    """
    kept: list[Motion] = []
    drawn, passed = 0, dict.fromkeys(tests, 0)
    while len(kept) < count and drawn < MAX_DRAWN:
        motion = draw()
        drawn += 1
        results = {name: test(motion) for name, test in tests.items()}
        passed = {name: number + results[name] for name, number in passed.items()}
        if all(results.values()):
            kept.append(motion)
    return kept, drawn, passed


def least_gap(partner: Motion, reaction: Motion) -> float:
    """Return the least distance of any two joints of motions ``(T, J, 3)``, in metres."""
    every = list(range(partner.shape[1]))
    return float(_gaps(partner, reaction, every, every).min())


def _ends(skeleton: Skeleton, kinds: Sequence[str]) -> Joints:
    """Return the joints at the ends of segments of some kinds."""
    ends = zip(skeleton.bones[:, 1].tolist(), segments(skeleton), strict=True)
    return [end for end, of in ends if of.kind in kinds]


def _hands(skeleton: Skeleton) -> dict[str, Joints]:
    """Return the joints of each hand, from the wrist on, by its side."""
    hands: dict[str, Joints] = {}
    for end, of in zip(skeleton.bones[:, 1].tolist(), segments(skeleton), strict=True):
        if of.part == "arm" and of.kind != "upper_arm":
            hands.setdefault(of.name.partition("_")[0], []).append(end)
    return hands


def _gaps(partner: Motion, reaction: Motion, own: Joints, others: Joints) -> NDArray[np.float64]:
    """Return the least distance of the reaction's joints from the partner's, ``(T,)`` metres."""
    differences = (reaction[:, i] - partner[:, j] for i in own for j in others)
    gaps: NDArray[np.float64] = reduce(
        np.minimum, (np.linalg.norm(difference, axis=-1) for difference in differences)
    )
    return gaps
