"""The joints that metrics speak of, found by name in any skeleton."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.skeleton import Skeleton

# Of each limb the first word that names a joint of either side; data sets differ in what they have.
_FEET = ("foot", "toe", "ankle", "heel")
_HANDS = ("hand", "wrist")


@dataclass(frozen=True)
class Body:
    """What metrics need to know of a skeleton.

    Parameters
    ----------
    root : index of the root joint
    keys : indices of the joints whose distances between two bodies are looked at
    feet : indices of the joints that stand on the ground; none if the skeleton names none
    bones : (E, 2) indices, parent and child
    """

    root: int
    keys: tuple[int, ...]
    feet: tuple[int, ...]
    bones: NDArray[np.intp]


def body_of(skeleton: Skeleton) -> Body:
    """Find root, head, hands and feet by name; without any of these, every joint is a key."""
    feet, hands = _sides(skeleton, _FEET), _sides(skeleton, _HANDS)
    head = tuple(i for i, name in enumerate(skeleton.joints) if "head" in name.lower())[:1]
    found = sorted({skeleton.root, *head, *hands, *feet})
    complete = bool(head and hands and feet)
    keys = tuple(found) if complete else tuple(range(len(skeleton.joints)))
    return Body(root=skeleton.root, keys=keys, feet=feet, bones=skeleton.bones)


def _sides(skeleton: Skeleton, words: tuple[str, ...]) -> tuple[int, ...]:
    """Find the mirror joints of a limb's end by the first word that names any."""
    paired = sorted({joint for pair in skeleton.left_right for joint in pair})
    for word in words:
        named = tuple(i for i in paired if word in skeleton.joints[i].lower())
        if named:
            return named
    return ()
