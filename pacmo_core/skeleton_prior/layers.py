"""Graph convolution in space and time, and what else all networks are made of.

Tensors are ``(T, J, B, C)``: time, joint, batch, channel. So channels are one product of matrices,
joints one a frame, wide enough for the processor, and a recurrence finds each frame in one piece.

Where factors are rounded (``products``), so is what layers of these give, until it is ``exact``.
"""

import torch
from torch import Tensor, nn

from pacmo_core.skeleton_prior.products import Mixing, Sliding, Weighing, exact

KERNEL = 5
LEAK = 0.1


class Dense(nn.Linear):
    """A dense layer on channels, which may come in several parts."""

    def forward(self, *parts: Tensor) -> Tensor:
        """``(..., C1)``, ``(..., C2)``, ... to ``(..., D)``."""
        out: Tensor = Weighing.apply(self.weight, self.bias, *parts)  # type: ignore[no-untyped-call]  # torch leaves it untyped
        return out


class GraphConvolution(nn.Module):
    """``A X W + X U`` (supplement, equation 1, before its ReLU).

    The links may be weighed and joined anew, as in Li et al. (2020): ``A * mask + added``.

    Parameters
    ----------
    links : (J, J), the part of the adjacency off its diagonal
    in_channels, out_channels : int
    """

    links: Tensor

    def __init__(self, links: Tensor, in_channels: int, out_channels: int) -> None:
        super().__init__()
        self.register_buffer("links", links, persistent=False)
        self.mask = nn.Parameter(torch.ones_like(links))
        self.added = nn.Parameter(torch.zeros_like(links))
        self.along = nn.Linear(in_channels, out_channels, bias=False)
        self.own = nn.Linear(in_channels, out_channels)

    def forward(self, x: Tensor) -> Tensor:
        """``(T, J, ..., C)`` to the same with other channels."""
        weights = self.links * self.mask + self.added
        own = self.own
        out: Tensor = Mixing.apply(x, weights, self.along.weight, own.weight, own.bias)  # type: ignore[no-untyped-call]  # torch leaves it untyped
        return out


class TimeConvolution(nn.Module):
    """A convolution of five frames, centred; what is beyond the ends is zero.

    Parameters
    ----------
    in_channels, out_channels : int
    stride : frames in to one out
    """

    def __init__(self, in_channels: int, out_channels: int, *, stride: int) -> None:
        super().__init__()
        self.stride = stride
        self.weigh = nn.Linear(KERNEL * in_channels, out_channels)  # the frames one after another

    def forward(self, x: Tensor) -> Tensor:
        """``(T, J, B, C)`` to ``(ceil(T / stride), J, B, C')``."""
        kernel = self.weigh.weight.view(-1, KERNEL, x.shape[-1])
        out: Tensor = Sliding.apply(x, kernel, self.weigh.bias, self.stride)  # type: ignore[no-untyped-call]  # torch leaves it untyped
        return out


class ChannelNorm(nn.BatchNorm1d):
    """Batch normalisation of the last axis over all others."""

    def forward(self, x: Tensor, *, active: bool = False) -> Tensor:
        """``(..., C)`` to the same; ``active``: through a ReLU.

        Done in place on a view, it would copy the whole gradient twice.
        """
        normed = super().forward(x.reshape(-1, x.shape[-1]))
        return (normed.relu_() if active else normed).view(x.shape)


class StGcn(nn.Module):
    """One ST-GCN layer: graph, ReLU, norm, ReLU, time, norm, dropout, residual, ReLU.

    The order of the supplement, 3.1; residual and last ReLU of Li et al. (2020), on whose layer it
    says it is built: through a convolution of one frame where the shape changes, none in a first
    layer.

    Parameters
    ----------
    links : (J, J)
    in_channels, out_channels : int
    stride : frames in to one out
    dropout : share
    residual : whether the input is added
    """

    def __init__(
        self,
        links: Tensor,
        in_channels: int,
        out_channels: int,
        *,
        stride: int,
        dropout: float,
        residual: bool,
    ) -> None:
        super().__init__()
        self.graph = GraphConvolution(links, in_channels, out_channels)
        self.norms = nn.ModuleList([ChannelNorm(out_channels) for _ in range(2)])
        self.time = TimeConvolution(out_channels, out_channels, stride=stride)
        self.stride, self.dropout, self.residual = stride, dropout, residual
        self.active = True  # whether the last ReLU is there
        same = in_channels == out_channels and stride == 1
        self.shortcut: nn.Module = nn.Identity()
        if residual and not same:
            self.shortcut = nn.Sequential(
                Dense(in_channels, out_channels), ChannelNorm(out_channels)
            )

    def forward(self, x: Tensor, random: torch.Generator | None) -> Tensor:
        """``(T, J, B, C)`` to ``(ceil(T / stride), J, B, C')``.

        Parameters
        ----------
        random : draws what is dropped; none, nothing is
        """
        # In place where torch allows: these are the largest tensors of all.
        spatial = self.norms[0](self.graph(x).relu(), active=True)
        active = self.active and not self.residual
        out: Tensor = self.norms[1](self.time(spatial), active=active)
        out = drop(out, self.dropout, random)
        if not self.residual:
            return out
        # A slice of everything would cost its gradient two passes over memory.
        out = out + self.shortcut(x if self.stride == 1 else x[:: self.stride])
        return out.relu_() if self.active else out


class Silent(nn.Linear):
    """A dense layer that says nothing before it has learnt: its weights begin at zero."""


class Head(nn.Module):
    """Three dense layers with leaky ReLU between them (supplement, tables 12 and 16).

    Parameters
    ----------
    hidden, out_channels : int
    last : the kind of the last layer
    """

    def __init__(self, hidden: int, out_channels: int, last: type[nn.Linear] = nn.Linear) -> None:
        super().__init__()
        self.layers = nn.ModuleList(
            [Dense(hidden, hidden), Dense(hidden, hidden), last(hidden, out_channels)]
        )

    def forward(self, *parts: Tensor) -> Tensor:
        """``(..., h)``, in one part or several, to ``(..., C)``."""
        first, second, last = self.layers
        x = second(nn.functional.leaky_relu(first(*parts), LEAK))
        out: Tensor = last(exact(nn.functional.leaky_relu(x, LEAK)))
        return out


def by_frame(x: Tensor) -> Tensor:
    """``(B, T, J, C)`` to ``(T, J, B, C)``, as the layers take it."""
    return x.permute(1, 2, 0, 3).contiguous()


def by_row(x: Tensor) -> Tensor:
    """``(T, J, B, C)`` back to ``(B, T, J, C)``."""
    return x.permute(2, 0, 1, 3)


def drop(x: Tensor, share: float, random: torch.Generator | None) -> Tensor:
    """Set a share of the values to zero and raise the others, by an explicit generator."""
    if random is None or not share:
        return x
    kept = torch.empty(x.shape, device="cpu").bernoulli_(1 - share, generator=random)
    return x * (kept.to(x.device) / (1 - share))
