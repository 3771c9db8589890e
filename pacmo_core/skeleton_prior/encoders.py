"""ST-GCN1, 2 and 3: a motion as one code a joint (supplement, tables 11, 13, 14 and 15)."""

import torch
from torch import Tensor, nn

from pacmo_core.skeleton_prior.layers import StGcn, by_frame
from pacmo_core.skeleton_prior.products import exact

STRIDES = (1, 2, 2, 2, 1)


def widths(hidden: int) -> tuple[int, ...]:
    """Channels of the five layers, 32 to 256 in the paper's size; the last two are alike."""
    return (hidden // 8, hidden // 4, hidden // 2, hidden, hidden)


class MotionEncoder(nn.Module):
    """Five ST-GCN layers, three of which halve the frames, then the mean over time.

    Parameters
    ----------
    links : (J, J)
    in_channels : int
    channels : of the five layers
    dropout : share
    """

    def __init__(
        self, links: Tensor, in_channels: int, channels: tuple[int, ...], *, dropout: float
    ) -> None:
        super().__init__()
        pairs = zip((in_channels, *channels[:-1]), channels, STRIDES, strict=True)
        self.layers = nn.ModuleList(
            [
                StGcn(links, before, after, stride=stride, dropout=dropout, residual=number > 0)
                for number, (before, after, stride) in enumerate(pairs)
            ]
        )

    def forward(self, x: Tensor, random: torch.Generator | None) -> Tensor:
        """``(B, T, J, C)`` to ``(B, J, C')``."""
        x = by_frame(x)
        for layer in self.layers:
            x = layer(x, random)
        return exact(x).mean(dim=0).transpose(0, 1)


def ends(template: Tensor) -> Tensor:
    """``(B, J, 6)``: the first and the last pose of a template, metres."""
    return torch.cat([template[:, 0], template[:, -1]], dim=-1)


def everywhere(scales: Tensor, n_frames: int) -> Tensor:
    """``(B, J)`` to ``(B, T, J, 1)``, less 1: how much each bone grows."""
    return (scales - 1)[:, None, :, None].expand(-1, n_frames, -1, -1)
