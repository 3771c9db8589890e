"""Layers of the networks: graph convolution, ST-GCN and graph GRU.

Convolutions take ``(B, C, T, J)``: batch, channels, frames, joints in the skeleton's order.

References
----------
Li et al. (2020), Dynamic multiscale graph neural networks for 3D skeleton based human motion
prediction (DMGNN).
"""

import math
from itertools import pairwise

import numpy as np
import torch
from torch import Tensor, nn

from pacmo_core.data.skeleton import Skeleton

TEMPORAL_KERNEL = 5
ENCODER_STRIDES = (1, 2, 2, 2, 1)


def normalised_adjacency(skeleton: Skeleton) -> Tensor:
    """Compute ``A D^-1`` (J, J) float32 of bones and self-loops: columns sum to 1, as in DMGNN."""
    adjacency = np.eye(len(skeleton.joints))
    parent, child = skeleton.bones.T
    adjacency[parent, child] = adjacency[child, parent] = 1
    return torch.tensor(adjacency / adjacency.sum(axis=0), dtype=torch.float32)


def off_diagonal_adjacency(skeleton: Skeleton) -> Tensor:
    """Compute the normalised adjacency (J, J) float32 with a zero diagonal."""
    adjacency = normalised_adjacency(skeleton)
    return adjacency - torch.diag(adjacency.diagonal())


class LearntAdjacency(nn.Module):
    """``A * edge_mask + edge_offset``: an adjacency (J, J) that is learnt, as in DMGNN."""

    adjacency: Tensor

    def __init__(self, adjacency: Tensor) -> None:
        super().__init__()
        self.register_buffer("adjacency", adjacency, persistent=False)
        self.edge_mask = nn.Parameter(torch.ones_like(adjacency))
        self.edge_offset = nn.Parameter(torch.zeros_like(adjacency))

    def forward(self) -> Tensor:
        """Compute the adjacency (J, J)."""
        return self.adjacency * self.edge_mask + self.edge_offset


class GraphConvolution(nn.Module):
    """``A X W + X U + b`` (supplement, equation 1, before its ReLU)."""

    def __init__(self, adjacency: Tensor, in_channels: int, out_channels: int) -> None:
        super().__init__()
        self.adjacency = LearntAdjacency(adjacency)
        self.linear = nn.Conv2d(2 * in_channels, out_channels, 1)  # W and U side by side

    def forward(self, x: Tensor) -> Tensor:
        """Map ``(B, C, T, J)`` to ``(B, C', T, J)``."""
        out: Tensor = self.linear(torch.cat([x @ self.adjacency().T, x], dim=1))
        return out


class StGcnLayer(nn.Module):
    """Spatio-temporal graph convolution (ST-GCN): one layer (supplement, 3.1).

    Graph convolution, ReLU, batch norm, ReLU, temporal convolution, batch norm; residual connection
    and ReLU as in DMGNN, on which the supplement's layer is based. Where the shape changes, the
    residual is a 1 x 1 convolution; the first layer of a network has none.

    Parameters
    ----------
    adjacency : (J, J), with a zero diagonal
    channels : of input and output
    stride : frames
    """

    def __init__(
        self,
        adjacency: Tensor,
        channels: tuple[int, int],
        *,
        stride: int = 1,
        residual: bool = True,
        final_relu: bool = True,
    ) -> None:
        super().__init__()
        into, out = channels
        self.residual, self.final_relu = residual, final_relu
        self.spatial = nn.Sequential(
            GraphConvolution(adjacency, into, out), nn.ReLU(), nn.BatchNorm2d(out), nn.ReLU()
        )
        kernel, padding = (TEMPORAL_KERNEL, 1), (TEMPORAL_KERNEL // 2, 0)
        self.temporal = nn.Sequential(
            nn.Conv2d(out, out, kernel, (stride, 1), padding), nn.BatchNorm2d(out)
        )
        self.shortcut: nn.Module = nn.Identity()
        if residual and (into, stride) != (out, 1):
            self.shortcut = nn.Sequential(nn.Conv2d(into, out, 1, (stride, 1)), nn.BatchNorm2d(out))

    def forward(self, x: Tensor) -> Tensor:
        """Map ``(B, C, T, J)`` to ``(B, C', ceil(T / stride), J)``."""
        out: Tensor = self.temporal(self.spatial(x))
        if self.residual:
            out = out + self.shortcut(x)
        return out.relu() if self.final_relu else out


def encoder_channels(hidden: int) -> tuple[int, ...]:
    """List the channels of the encoder's layers: 32, 64, 128, 256, 256 for ``hidden`` 256."""
    return (hidden // 8, hidden // 4, hidden // 2, hidden, hidden)


class StGcnEncoder(nn.Module):
    """ST-GCN1, 2 and 3: five layers, three of them of stride 2, and the mean over time.

    Supplement, tables 11, 13 and 14.
    """

    def __init__(self, adjacency: Tensor, in_channels: int, channels: tuple[int, ...]) -> None:
        super().__init__()
        sizes = zip(pairwise((in_channels, *channels)), ENCODER_STRIDES, strict=True)
        self.layers = nn.Sequential(
            *(
                StGcnLayer(adjacency, pair, stride=stride, residual=number > 0)
                for number, (pair, stride) in enumerate(sizes)
            )
        )

    def forward(self, x: Tensor) -> Tensor:
        """Map ``(B, C, T, J)`` to ``(B, J, C')``."""
        encoded: Tensor = self.layers(x).mean(dim=2)
        return encoded.mT


class GraphGru(nn.Module):
    """The graph gated recurrent unit (G-GRU).

    With the message ``M = A H W``::

        r  = sigmoid(r_in(x) + r_hid(M))
        u  = sigmoid(u_in(x) + u_hid(M))
        c  = tanh(c_in(x) + r * c_hid(M))
        H' = u * H + (1 - u) * c

    Unlike the supplement's equation 2, the sums are inside the sigmoid, as in DMGNN, and all
    products are elementwise. One message serves all gates.
    """

    def __init__(self, adjacency: Tensor, in_channels: int, hidden: int) -> None:
        super().__init__()
        self.adjacency = LearntAdjacency(adjacency)
        self.message = nn.Linear(hidden, hidden, bias=False)
        self.gates_in = nn.Linear(in_channels, 3 * hidden)  # reset, update, candidate
        self.gates_hidden = nn.Linear(hidden, 3 * hidden, bias=False)

    def forward(self, x: Tensor, state: Tensor, adjacency: Tensor) -> Tensor:
        """Advance the state (B, J, h) by one frame (B, J, C), over ``self.adjacency()``."""
        gates_in = self.gates_in(x).chunk(3, dim=-1)
        gates_hidden = self.gates_hidden(self.message(adjacency @ state)).chunk(3, dim=-1)
        reset, update = ((gates_in[i] + gates_hidden[i]).sigmoid() for i in (0, 1))
        candidate = torch.tanh(gates_in[2] + reset * gates_hidden[2])
        return torch.lerp(candidate, state, update)


class ZeroInitLinear(nn.Linear):
    """A linear layer whose weights and bias are zero before training."""


# Layers whose own parameters keep the constructor's values: ones and zeros.
CONSTANT_INITIALISED = (LearntAdjacency, nn.BatchNorm2d)


def initialise_weights(module: nn.Module, random: torch.Generator) -> None:
    """Initialise all weights of a module, in order, from an explicit generator.

    Linear layers and convolutions are uniform within +-1 / sqrt(fan-in), as torch initialises them
    from its global generator.

    Raises
    ------
    TypeError
        If a layer is of an unknown class.
    """
    for layer in module.modules():
        own = list(layer.parameters(recurse=False))
        if not own or isinstance(layer, CONSTANT_INITIALISED):
            continue
        if not isinstance(layer, (nn.Linear, nn.Conv1d, nn.Conv2d, nn.ConvTranspose2d)):
            raise TypeError(f"no initialisation for layers of class {type(layer).__name__}")
        bound = 1 / math.sqrt(math.prod(layer.weight.shape[1:]))
        bound = 0.0 if isinstance(layer, ZeroInitLinear) else bound
        for weight in own:
            with torch.no_grad():
                weight.copy_(torch.empty(weight.shape).uniform_(-bound, bound, generator=random))
