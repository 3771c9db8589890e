"""F-CNN and F-GCN: baselines that see one frame at a time (supplement, tables 17 and 18).

The tables halve the joints and leave open how an odd number is halved: here with the larger half,
25 to 13, 7 and 4, and up again by transposed convolutions of kernel 3, stride 2 and padding 1,
which go back exactly. What is joined at an eighth of the joints is averaged over the same joints.
"""

from itertools import pairwise

import torch
from torch import Tensor, nn

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.skeleton_prior.character import Character, Code, Gaussian, Given
from pacmo_core.skeleton_prior.encoders import everywhere
from pacmo_core.skeleton_prior.graph import neighbours
from pacmo_core.skeleton_prior.layers import GraphConvolution, by_frame, by_row
from pacmo_core.skeleton_prior.lines import Line, LineUp, pooled
from pacmo_core.skeleton_prior.paper import beside
from pacmo_core.skeleton_prior.placing import Offsets
from pacmo_core.skeleton_prior.products import exact


class FrameCnn(Character):
    """F-CNN of a character: convolutions along the joints in their order.

    Parameters
    ----------
    skeleton : Skeleton
    hidden : 256 in the paper's size
    first : whether it is told its body, or its partner
    """

    def __init__(self, skeleton: Skeleton, *, hidden: int, first: bool) -> None:
        super().__init__()
        self.place, self.first, self.hidden = Offsets(), first, hidden
        sizes = [len(skeleton.joints)]
        for _ in range(3):
            sizes.append((sizes[-1] + 1) // 2)
        self.sizes = sizes
        down = (hidden // 8, hidden // 4, hidden // 2, hidden)
        # The first character's decoder is not the encoder's mirror; the tables have it so.
        up = (
            (hidden, hidden // 2, hidden // 8) if first else (hidden // 2, hidden // 4, hidden // 8)
        )
        told = 4 if first else 8
        self.down = nn.ModuleList([Line(a, b) for a, b in zip((3, *down), down, strict=False)])
        self.code = Gaussian(hidden + told, hidden)
        self.lifting = nn.Linear(hidden + told, hidden)
        self.up = nn.ModuleList([LineUp(a, b) for a, b in zip((hidden, *up), up, strict=False)])
        self.out = nn.Linear(up[-1], 3)

    def latent_shape(self, given: Given) -> tuple[int, ...]:
        """One code a frame and eighth of the joints."""
        return (*given.template.shape[:2], self.sizes[-1], self.hidden)

    def encode(self, motion: Tensor, given: Given, random: torch.Generator | None) -> Code:
        """Encode each frame's offsets."""
        del random  # nothing is dropped
        x = self.down[0]((motion - given.template) / given.unit)
        for layer in self.down[1:]:
            x = pooled(layer(x), most=True)
        code: Code = self.code(torch.cat([x, self._told(given)], dim=-1))
        return code

    def decode(self, latent: Tensor, given: Given) -> Tensor:
        """Decode each frame."""
        x = self.lifting(torch.cat([latent, self._told(given)], dim=-1)).relu()
        for layer, size in zip(self.up, self.sizes[2::-1], strict=True):
            x = layer(x, size)
        field: Tensor = self.out(x)
        return field * given.unit

    def _told(self, given: Given) -> Tensor:
        told = told_first(given) if self.first else beside(given)
        for _ in range(3):
            told = pooled(told, most=False)
        return told


class FrameGcn(Character):
    """F-GCN of a character: graph convolutions, joint by joint.

    Parameters
    ----------
    skeleton : Skeleton
    hidden : 256 in the paper's size
    first : whether it is told its body in 20 channels, or its partner in 16
    """

    def __init__(self, skeleton: Skeleton, *, hidden: int, first: bool) -> None:
        super().__init__()
        self.place, self.first, self.hidden = Offsets(), first, hidden
        links = neighbours(skeleton)
        told = 20 if first else 16
        self.telling = nn.Linear(4 if first else 6, told)
        quarter, half = hidden // 4, hidden // 2
        self.before = _graphs(links, (3, hidden // 8, quarter))
        self.after = _graphs(links, (quarter + told, half))
        self.code = nn.ModuleList([GraphConvolution(links, half, hidden) for _ in range(2)])
        decoder = (hidden + told, hidden, half, quarter, hidden // 8)
        self.decoder = _graphs(links, decoder)
        self.last = GraphConvolution(links, hidden // 8, 3)
        self.out = nn.Linear(3, 3)

    def latent_shape(self, given: Given) -> tuple[int, ...]:
        """One code a frame and joint."""
        return (*given.template.shape[:3], self.hidden)

    def encode(self, motion: Tensor, given: Given, random: torch.Generator | None) -> Code:
        """Encode each frame's offsets."""
        del random  # nothing is dropped
        x = _through(self.before, by_frame((motion - given.template) / given.unit))
        x = _through(self.after, torch.cat([x, by_frame(self._told(given))], dim=-1))
        mean, log_variance = (by_row(exact(layer(x))) for layer in self.code)
        return Code(mean, log_variance.clamp(-10, 4))

    def decode(self, latent: Tensor, given: Given) -> Tensor:
        """Decode each frame."""
        x = by_frame(torch.cat([latent, self._told(given)], dim=-1))
        field: Tensor = self.out(by_row(exact(self.last(_through(self.decoder, x)))))
        return field * given.unit

    def _told(self, given: Given) -> Tensor:
        both = torch.cat([given.partner, given.template], dim=-1)
        told: Tensor = self.telling(told_first(given) if self.first else both)
        return told


def told_first(given: Given) -> Tensor:
    """``(B, T, J, 4)``: the own template and the own body."""
    grown = everywhere(given.scales, given.template.shape[1])
    return torch.cat([given.template, grown], dim=-1)


def _graphs(links: Tensor, channels: tuple[int, ...]) -> nn.ModuleList:
    pairs = pairwise(channels)
    return nn.ModuleList([GraphConvolution(links, a, b) for a, b in pairs])


def _through(layers: nn.ModuleList, x: Tensor) -> Tensor:
    for layer in layers:
        x = layer(x).relu()
    return x
