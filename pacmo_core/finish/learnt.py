"""What a finish learnt from reactions to held-out partners, as arrays and as part of a model."""

from dataclasses import dataclass, fields

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.finish.contacts import no_contacts
from pacmo_core.finish.floor import ONE_FLOOR
from pacmo_core.finish.heights import no_change
from pacmo_core.finish.travel import NO_LIMIT
from pacmo_core.finish.trunk import unshaped
from pacmo_core.finish.twitches import NO_ACCELERATION_LIMIT

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Learnt:
    """What reactions to held-out partners taught.

    Parameters
    ----------
    contacts : (P, 4) of ``contacts.learn_contacts``, of P kinds of pairs of joints
    heights : (2, K) of ``heights.learn_heights``
    trunk : (D + 2, D) of ``trunk.learn_trunk``
    max_speeds : (2,) of ``travel.peak_speeds``, the largest of captured motion
    max_accelerations : (J,) of ``twitches.peak_accelerations``, the largest of captured motion
    least_distance : () metres of the two trunks (``avoidance.trunk_offset``)
    floor_tolerance : () metres, of ``floor.learn_floor_tolerance``
    leaves_floor : () 1 where captured bodies are off the floor at times (``floor.MIN_ALOFT``), or 0
    """

    contacts: Array
    heights: Array
    trunk: Array
    max_speeds: Array
    max_accelerations: Array
    least_distance: Array
    floor_tolerance: Array
    leaves_floor: Array


def nothing_learnt(skeleton: Skeleton) -> Learnt:
    """Return arrays of the shapes of those that are learnt, which change nothing."""
    return Learnt(
        contacts=no_contacts(skeleton),
        heights=no_change(),
        trunk=unshaped(skeleton),
        max_speeds=np.array([NO_LIMIT, NO_LIMIT]),
        max_accelerations=np.full(len(skeleton.joints), NO_ACCELERATION_LIMIT),
        least_distance=np.array(0.0),
        floor_tolerance=np.array(ONE_FLOOR),
        leaves_floor=np.array(0.0),
    )


class LearntModule(nn.Module):
    """The arrays of a ``Learnt`` as buffers, which change nothing until they are learnt."""

    def __init__(self, skeleton: Skeleton) -> None:
        super().__init__()
        self._skeleton = skeleton
        for name, array in vars(nothing_learnt(skeleton)).items():
            self.register_buffer(name, torch.from_numpy(array).float())

    def read(self) -> Learnt:
        """Return the arrays."""
        names = [entry.name for entry in fields(Learnt)]
        arrays = {name: self.get_buffer(name).cpu().numpy() for name in names}
        return Learnt(**{name: array.astype(np.float64) for name, array in arrays.items()})

    @property
    def has_learnt(self) -> bool:
        """Whether anything was learnt."""
        nothing = vars(nothing_learnt(self._skeleton))
        return any(
            not torch.equal(self.get_buffer(name).cpu(), torch.from_numpy(array).float())
            for name, array in nothing.items()
        )

    def store(self, learnt: Learnt) -> None:
        """Keep arrays of the same shapes."""
        for name, array in vars(learnt).items():
            self.get_buffer(name).copy_(torch.from_numpy(array))
