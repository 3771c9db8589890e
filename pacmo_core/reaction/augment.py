"""Other captures that could as well have been made: mirrored, of another size, turned, resampled.

An interaction and its mirror image are equally natural, as are larger or smaller people; the
heading of a partner's first pose is known up to a camera's noise; and one motion is one function,
at whatever rate it was captured. With few captures each of these is worth many of them.
"""

from dataclasses import replace

import numpy as np
import torch
from scipy.interpolate import CubicSpline
from torch import Tensor

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.reaction.functions import MotionPairs
from pacmo_core.reaction.settings import AugmentSettings

MIRROR_X = (-1.0, 1.0, 1.0)  # in the partner's frame left is +x


class Augment:
    """Change a batch at random, both people alike but for the frame rate, which is the partner's.

    Parameters
    ----------
    settings : AugmentSettings
    skeleton : Skeleton
    n_points : grid of the functions
    """

    def __init__(self, settings: AugmentSettings, skeleton: Skeleton, n_points: int) -> None:
        self.settings = settings
        swapped = dict(skeleton.left_right) | {right: left for left, right in skeleton.left_right}
        self.mirrored = torch.tensor([swapped.get(i, i) for i in range(len(skeleton.joints))])
        least = max(4, round(settings.least_rate * n_points))
        self.resamplings = [resampled(n_points, n) for n in range(least, n_points)]

    def __call__(self, pairs: MotionPairs, random: torch.Generator) -> MotionPairs:
        """Draw anew for each interaction; the frame rate for the batch."""
        place = place_of(len(pairs), self.settings, random).to(pairs.partner.device)
        mirror = torch.rand(len(pairs), generator=random) < self.settings.mirror
        partner, reaction = (
            self._seen(motion, mirror.to(motion.device), place)
            for motion in (pairs.partner, pairs.reaction)
        )
        if self.resamplings:
            rate = int(torch.randint(len(self.resamplings) + 1, (), generator=random))
            if rate < len(self.resamplings):
                partner = self.resamplings[rate].to(partner.device) @ partner
        return replace(pairs, partner=partner, reaction=reaction)

    def _seen(self, motion: Tensor, mirror: Tensor, place: Tensor) -> Tensor:
        joints = motion.view(*motion.shape[:-1], -1, 3)
        image = joints[:, :, self.mirrored] * joints.new_tensor(MIRROR_X)
        joints = torch.where(mirror[:, None, None, None], image, joints)
        return (joints @ place[:, None]).flatten(2)


def place_of(n: int, settings: AugmentSettings, random: torch.Generator) -> Tensor:
    """Draw ``(n, 3, 3)`` turns about the vertical, each times a size, for rows from the right."""
    angle = settings.turn * torch.randn(n, generator=random)
    size = (settings.size * torch.randn(n, generator=random)).exp()
    cos, sin, zero, one = angle.cos(), angle.sin(), torch.zeros(n), torch.ones(n)
    rows = [[cos, zero, -sin], [zero, one, zero], [sin, zero, cos]]
    return size[:, None, None] * torch.stack([torch.stack(row, dim=-1) for row in rows], dim=-2)


def resampled(n_points: int, n_frames: int) -> Tensor:
    """Build the matrix ``(N, N)`` that keeps what so many even frames tell a spline."""
    grid, frames = np.linspace(0, 1, n_points), np.linspace(0, 1, n_frames)
    taken = CubicSpline(grid, np.eye(n_points))(frames)
    return torch.tensor(CubicSpline(frames, taken)(grid), dtype=torch.float32)
