"""Graph convolution in space and time, and the graph gated recurrent unit.

Tensors are ``(B, T, J, C)``: batch, time, joint, channel, so that every layer is one product of
matrices over the channels.
"""

import torch
from torch import Tensor, nn

KERNEL = 5
LEAK = 0.1


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
        """``(..., J, C)`` to the same with other channels."""
        weights = self.links * self.mask + self.added
        # The narrower side is mixed over joints: mixing commutes with the weights.
        if self.along.in_features <= self.along.out_features:
            mixed: Tensor = self.along(weights @ x)
        else:
            mixed = weights @ self.along(x)
        out: Tensor = mixed + self.own(x)
        return out


class TimeConvolution(nn.Module):
    """A convolution of five frames, centred; what is beyond the ends is zero.

    Unlike the two-dimensional convolution of torch, which wants channels elsewhere and whose
    gradient fails outright in some shapes on a CPU, this is a product of matrices.

    Parameters
    ----------
    in_channels, out_channels : int
    stride : frames in to one out
    """

    def __init__(self, in_channels: int, out_channels: int, *, stride: int) -> None:
        super().__init__()
        self.stride = stride
        self.weigh = nn.Linear(KERNEL * in_channels, out_channels)

    def forward(self, x: Tensor) -> Tensor:
        """``(B, T, J, C)`` to ``(B, ceil(T / stride), J, C')``."""
        n_frames = x.shape[1]
        padded = nn.functional.pad(x, (0, 0, 0, 0, KERNEL // 2, KERNEL // 2))
        around = [padded[:, shift : shift + n_frames : self.stride] for shift in range(KERNEL)]
        out: Tensor = self.weigh(torch.cat(around, dim=-1))
        return out


class ChannelNorm(nn.BatchNorm1d):
    """Batch normalisation of the last axis over all others."""

    def forward(self, x: Tensor) -> Tensor:
        """``(..., C)`` to the same."""
        return super().forward(x.reshape(-1, x.shape[-1])).view(x.shape)


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
                nn.Linear(in_channels, out_channels), ChannelNorm(out_channels)
            )

    def forward(self, x: Tensor, random: torch.Generator | None) -> Tensor:
        """``(B, T, J, C)`` to ``(B, ceil(T / stride), J, C')``.

        Parameters
        ----------
        random : draws what is dropped; none, nothing is
        """
        # In place where torch allows: these are the largest tensors of all.
        spatial = self.norms[0](self.graph(x).relu_()).relu_()
        out = drop(self.norms[1](self.time(spatial)), self.dropout, random)
        if self.residual:
            out = out + self.shortcut(x[:, :: self.stride])
        return out.relu_() if self.active else out


class GraphGru(nn.Module):
    """The graph gated recurrent unit over whole sequences.

    With the message ``M = A H W``::

        r  = s(r_in(x) + r_hid(M))
        u  = s(u_in(x) + u_hid(M))
        c  = tanh(c_in(x) + r * c_hid(M))
        H' = u * H + (1 - u) * c

    Unlike the supplement's equation 2, the gates' sums stand inside the sigmoid, without which
    they are no gates, and all products are elementwise. One message serves all gates.

    Parameters
    ----------
    adjacency : (J, J), each joint with itself among them
    in_channels, hidden : int
    """

    adjacency: Tensor

    def __init__(self, adjacency: Tensor, in_channels: int, hidden: int) -> None:
        super().__init__()
        self.register_buffer("adjacency", adjacency)
        self.hidden = hidden
        self.mask = nn.Parameter(torch.ones_like(adjacency))
        self.added = nn.Parameter(torch.zeros_like(adjacency))
        self.message = nn.Linear(hidden, hidden, bias=False)
        self.gates_in = nn.Linear(in_channels, 3 * hidden)  # reset, update, candidate
        self.gates_hidden = nn.Linear(hidden, 3 * hidden, bias=False)

    def weights(self) -> tuple[Tensor, Tensor]:
        """Fold what is constant over a sequence: links (J, J), message with gates (h, 3h)."""
        folded = self.message.weight.T @ self.gates_hidden.weight.T
        return self.adjacency * self.mask + self.added, folded

    def step(self, weights: tuple[Tensor, Tensor], given: Tensor, state: Tensor) -> Tensor:
        """Go one frame on, joints first, so that both products are of two plain matrices.

        Parameters
        ----------
        weights : as ``weights`` folds them
        given : (J, B, 3h), the input through ``gates_in``
        state : (J, B, h)
        """
        links, folded = weights
        n_joints, n_rows, hidden = state.shape
        mixed = links @ state.reshape(n_joints, -1)
        gates = (mixed.view(-1, hidden) @ folded).view(n_joints, n_rows, 3 * hidden)
        both = torch.sigmoid(given[..., : 2 * hidden] + gates[..., : 2 * hidden])
        reset, update = both[..., :hidden], both[..., hidden:]
        candidate = torch.tanh(
            torch.addcmul(given[..., 2 * hidden :], reset, gates[..., 2 * hidden :])
        )
        return torch.lerp(candidate, state, update)

    def forward(self, x: Tensor, state: Tensor) -> Tensor:
        """Run over an input that is all known: its projections are one product over all time.

        Parameters
        ----------
        x : (B, T, J, C)
        state : (B, J, h), before the first frame

        Returns
        -------
        (B, T, J, h), the states after each frame
        """
        given = self.gates_in(x.permute(1, 2, 0, 3).contiguous())  # (T, J, B, 3h)
        weights, now = self.weights(), state.transpose(0, 1)
        states = []
        for frame in given.unbind():
            now = self.step(weights, frame, now)
            states.append(now)
        return torch.stack(states).permute(2, 0, 1, 3)


class Head(nn.Module):
    """Three dense layers with leaky ReLU between them (supplement, tables 12 and 16)."""

    def __init__(self, hidden: int, out_channels: int) -> None:
        super().__init__()
        self.layers = nn.ModuleList(
            [nn.Linear(hidden, hidden), nn.Linear(hidden, hidden), nn.Linear(hidden, out_channels)]
        )

    def forward(self, x: Tensor) -> Tensor:
        """``(..., h)`` to ``(..., C)``."""
        for layer in self.layers[:-1]:
            x = nn.functional.leaky_relu(layer(x), LEAK)
        out: Tensor = self.layers[-1](x)
        return out


def drop(x: Tensor, share: float, random: torch.Generator | None) -> Tensor:
    """Set a share of the values to zero and raise the others, by an explicit generator."""
    if random is None or not share:
        return x
    kept = torch.empty(x.shape, device="cpu").bernoulli_(1 - share, generator=random)
    return x * (kept.to(x.device) / (1 - share))
