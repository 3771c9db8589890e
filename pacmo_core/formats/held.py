"""A thing that a person holds at first, until it is handed over.

Once the other person has it, its place is that of the other's hand: a model that generates this
person must not be told. So it is known while it is held, and then stays in the hand it was in.
"""

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.skeleton import Skeleton

RELEASED = 0.05  # metres farther from the nearest hand than while the thing is held
HELD_SHARE = 0.25  # of the frames, from the first, in which it is held
MAX_HELD = 1.0  # metres from the nearest hand: a thing that is farther is held by nobody


def while_held(
    place: NDArray[np.float64], motion: NDArray[np.float64], skeleton: Skeleton, unit: float
) -> NDArray[np.float64]:
    """Return where a thing is while it is held, and afterwards would be in the hand that held it.

    It is released at the first frame from which it stays ``RELEASED`` farther from the nearest hand
    than in the median of the first frames. It then keeps its offset to that hand.

    Parameters
    ----------
    place : (T, 3) of the thing
    motion : (T, J, 3) of the person who holds it
    skeleton : of the person; without a joint named a hand all ends of limbs are hands
    unit : metres a unit of both

    Raises
    ------
    ValueError
        If it is not held at first, as in another unit or other axes than the person.
    """
    named = [i for i, joint in enumerate(skeleton.joints) if "hand" in joint.lower()]
    hands = motion[:, named or list(skeleton.end_effectors)]
    gaps = np.linalg.norm(hands - place[:, None], axis=-1) * unit
    nearest = gaps.min(axis=1)
    first = max(1, round(HELD_SHARE * len(nearest)))
    usual = np.median(nearest[:first])
    if usual > MAX_HELD:
        raise ValueError(
            f"{usual:.3g} m from the nearest hand at first: wanted at most {MAX_HELD:g} m"
        )
    is_away = nearest > usual + RELEASED
    held = np.flatnonzero(~is_away)
    if not len(held) or held[-1] + 1 == len(place):
        return place
    last = held[-1]
    hand = hands[:, gaps[last].argmin()]
    moved: NDArray[np.float64] = place.copy()
    moved[last + 1 :] = hand[last + 1 :] + (place[last] - hand[last])
    return moved
