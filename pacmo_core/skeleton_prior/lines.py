"""Convolutions over joints in a row, as if a body were a line: parts of the CNN baselines."""

import torch
from torch import Tensor, nn

from pacmo_core.skeleton_prior.layers import Dense
from pacmo_core.skeleton_prior.products import exact

KERNEL = 3


class Line(nn.Module):
    """A convolution over three joints in their order, and ReLU; products of matrices, as in layers.

    Parameters
    ----------
    in_channels, out_channels : int
    """

    def __init__(self, in_channels: int, out_channels: int) -> None:
        super().__init__()
        self.weigh = Dense(KERNEL * in_channels, out_channels)

    def forward(self, x: Tensor) -> Tensor:
        """``(..., J, C)`` to the same with other channels."""
        padded = nn.functional.pad(x, (0, 0, 1, 1))
        n = x.shape[-2]
        around = torch.cat([padded[..., i : i + n, :] for i in range(3)], dim=-1)
        out: Tensor = exact(self.weigh(around))
        return out.relu()


class LineUp(nn.Module):
    """A transposed convolution of kernel 3, stride 2 and padding 1, and ReLU: J to 2 J - 1 joints.

    An odd joint is the even kernel's; an even one takes the outer two of its neighbours.

    Parameters
    ----------
    in_channels, out_channels : int
    """

    def __init__(self, in_channels: int, out_channels: int) -> None:
        super().__init__()
        self.weigh = Dense(KERNEL * in_channels, out_channels)

    def forward(self, x: Tensor, n_joints: int) -> Tensor:
        """``(..., J, C)`` to ``(..., n_joints, C')``: 2 J - 1, or with the last one twice 2 J."""
        spread = x.new_zeros(*x.shape[:-2], 2 * x.shape[-2] + 1, x.shape[-1])
        spread[..., 1:-1:2, :] = x
        n = 2 * x.shape[-2] - 1
        around = torch.cat([spread[..., i : i + n, :] for i in range(3)], dim=-1)
        out: Tensor = exact(self.weigh(around)).relu()
        if n_joints > n:
            out = torch.cat([out, out[..., -1:, :]], dim=-2)
        return out


class Plane(nn.Module):
    """A convolution over three frames and three joints in their order.

    With stride 1 a transposed convolution is one too.

    Parameters
    ----------
    in_channels, out_channels : int
    """

    def __init__(self, in_channels: int, out_channels: int) -> None:
        super().__init__()
        self.weigh = Dense(KERNEL * KERNEL * in_channels, out_channels)

    def forward(self, x: Tensor) -> Tensor:
        """``(B, T, J, C)`` to the same with other channels."""
        n_frames, n_joints = x.shape[1:3]
        padded = nn.functional.pad(x, (0, 0, 1, 1, 1, 1))
        around = [
            padded[:, frame : frame + n_frames, joint : joint + n_joints]
            for frame in range(KERNEL)
            for joint in range(KERNEL)
        ]
        out: Tensor = exact(self.weigh(torch.cat(around, dim=-1)))
        return out


def most_around(x: Tensor) -> Tensor:
    """Pool ``(B, T, J, C)`` over three frames with stride 1: the most of them."""
    padded = torch.cat([x[:, :1], x, x[:, -1:]], dim=1)
    return torch.maximum(torch.maximum(padded[:, :-2], padded[:, 1:-1]), padded[:, 2:])


def pooled(x: Tensor, *, most: bool) -> Tensor:
    """Halve the joints ``(..., J, C)``, the larger half: the most of two, or their mean."""
    if x.shape[-2] % 2:
        x = torch.cat([x, x[..., -1:, :]], dim=-2)
    pairs = x.reshape(*x.shape[:-2], -1, 2, x.shape[-1])
    return pairs.amax(dim=-2) if most else pairs.mean(dim=-2)
