"""M-CNN and M-GCN: baselines that see whole motions at once (supplement, tables 19 and 20).

Their pooling keeps every frame and joint in the tables, so its stride is 1. What the tables call
encodings of the partner are dense layers here, but for the 8 channels that ST-GCN3 takes too.
"""

from itertools import pairwise

import torch
from torch import Tensor, nn

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.skeleton_prior.character import Character, Code, Gaussian, Given
from pacmo_core.skeleton_prior.encoders import everywhere
from pacmo_core.skeleton_prior.graph import neighbours
from pacmo_core.skeleton_prior.layers import StGcn, by_frame, by_row
from pacmo_core.skeleton_prior.lines import Plane, most_around
from pacmo_core.skeleton_prior.paper import PARTNER, beside
from pacmo_core.skeleton_prior.placing import Offsets
from pacmo_core.skeleton_prior.products import exact


class MotionCnn(Character):
    """M-CNN of a character: convolutions over frames and joints.

    Parameters
    ----------
    skeleton : Skeleton
    hidden : 256 in the paper's size, in which no layer here is wider than 64
    first : whether it is told its body, or its partner
    """

    def __init__(self, skeleton: Skeleton, *, hidden: int, first: bool) -> None:
        super().__init__()
        self.place, self.first, self.width = Offsets(), first, hidden // 4
        del skeleton
        wide, half, quarter = hidden // 4, hidden // 8, hidden // 16
        self.telling = nn.Identity() if first else nn.Linear(3, 8)
        down = (4, quarter, half) if first else (16, half)
        self.down = nn.ModuleList([Plane(a, b) for a, b in pairwise(down)])
        self.code = nn.ModuleList([Plane(half, wide) for _ in range(2)])
        self.lifting = nn.Linear(wide + (1 if first else 8), wide)
        up = (wide, half, quarter, 3) if first else (wide, half, quarter)
        self.up = nn.ModuleList([Plane(a, b) for a, b in pairwise(up)])
        self.out = nn.Linear(up[-1], 3)

    def latent_shape(self, given: Given) -> tuple[int, ...]:
        """One code a frame and joint."""
        return (*given.template.shape[:3], self.width)

    def encode(self, motion: Tensor, given: Given, random: torch.Generator | None) -> Code:
        """Encode the offsets with the body, or with the partner."""
        del random  # nothing is dropped
        offsets = (motion - given.template) / given.unit
        x = torch.cat([self.telling(offsets), self._told(given)], dim=-1)
        for layer in self.down:
            x = most_around(layer(x).relu())
        mean, log_variance = self.code
        return Code(mean(x), log_variance(x).clamp(-10, 4))

    def decode(self, latent: Tensor, given: Given) -> Tensor:
        """Decode the whole motion."""
        x = self.lifting(torch.cat([latent, self._told(given)], dim=-1)).relu()
        for number, layer in enumerate(self.up, start=1):
            # What has three channels is an offset, of either sign.
            x = layer(x) if self.first and number == len(self.up) else layer(x).relu()
        field: Tensor = self.out(x)
        return field * given.unit

    def _told(self, given: Given) -> Tensor:
        return everywhere(given.scales, given.template.shape[1]) if self.first else beside(given)


class MotionGcn(Character):
    """M-GCN of a character: the encoder's ST-GCN layers without strides, and their mirror.

    Unlike table 20 the last layer of the first character's has no ReLU: an offset has either sign.

    Parameters
    ----------
    skeleton : Skeleton
    hidden : 256 in the paper's size, in which no layer here is wider than 128
    dropout : share, of the encoder
    first : whether it is told its body, or its partner
    """

    def __init__(self, skeleton: Skeleton, *, hidden: int, dropout: float, first: bool) -> None:
        super().__init__()
        self.place, self.first, self.width = Offsets(), first, hidden // 2
        links = neighbours(skeleton)
        wide, half, quarter = hidden // 2, hidden // 4, hidden // 8
        told = 1 if first else PARTNER
        self.telling = nn.Identity() if first else nn.Linear(6, PARTNER)
        into = (4 if first else 3, quarter, half, wide)
        self.encoder = _stack(links, into, dropout, first=True)
        self.code = Gaussian(wide + (0 if first else told), wide)
        out = (wide + told, wide, half, quarter, *((hidden // 16, 3) if first else ()))
        self.decoder = _stack(links, out, 0.0, first=False, active=not first)
        self.out = nn.Identity() if first else nn.Linear(quarter, 3)

    def latent_shape(self, given: Given) -> tuple[int, ...]:
        """One code a frame and joint."""
        return (*given.template.shape[:3], self.width)

    def encode(self, motion: Tensor, given: Given, random: torch.Generator | None) -> Code:
        """Encode the offsets with the body, or with the partner."""
        x = (motion - given.template) / given.unit
        if self.first:
            x = torch.cat([x, self._told(given)], dim=-1)
        x = by_frame(x)
        for layer in self.encoder:
            x = layer(x, random)
        x = by_row(exact(x))
        code: Code = self.code(x if self.first else torch.cat([x, self._told(given)], dim=-1))
        return code

    def decode(self, latent: Tensor, given: Given) -> Tensor:
        """Decode the whole motion."""
        x = by_frame(torch.cat([latent, self._told(given)], dim=-1))
        for layer in self.decoder:
            x = layer(x, None)
        field: Tensor = self.out(by_row(exact(x)))
        return field * given.unit

    def _told(self, given: Given) -> Tensor:
        if self.first:
            return everywhere(given.scales, given.template.shape[1])
        told: Tensor = self.telling(torch.cat([given.partner, given.template], dim=-1))
        return told


def _stack(
    links: Tensor,
    channels: tuple[int, ...],
    dropout: float,
    *,
    first: bool,
    active: bool = True,
) -> nn.ModuleList:
    layers = [
        StGcn(links, a, b, stride=1, dropout=dropout, residual=not (first and number == 0))
        for number, (a, b) in enumerate(pairwise(channels))
    ]
    layers[-1].active = active
    return nn.ModuleList(layers)
