"""Layers of the networks: ST-GCN, graph GRU, and convolutions over joints.

Tensors of the graph layers are ``(T, J, B, C)``: time, joints, batch, channels. So a product over
channels is one matrix product, a product over joints is one per frame, and each frame of a
recurrence is contiguous. In mixed precision (``autograd_functions``) their results are bfloat16.

The convolutions over joints of the CNN baselines take ``(B, T, J, C)``, joints in the skeleton's
order.

References
----------
Li et al. (2020), Dynamic multiscale graph neural networks for 3D skeleton based human motion
prediction (DMGNN).
"""

import math

import numpy as np
import torch
from torch import Tensor, nn

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.skeleton_prior.autograd_functions import (
    GraphConvolutionFunction,
    GraphGruFunction,
    LinearFunction,
    TemporalConvolutionFunction,
    to_float32,
)

TEMPORAL_KERNEL, JOINT_KERNEL = 5, 3
LEAKY_SLOPE = 0.1
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


class ConcatLinear(nn.Linear):
    """A linear layer on the concatenated channels of several tensors."""

    def forward(self, *parts: Tensor) -> Tensor:
        """Map ``(..., C1)``, ``(..., C2)``, ... to ``(..., D)``."""
        out: Tensor = LinearFunction.apply(self.weight, self.bias, *parts)  # type: ignore[no-untyped-call]  # torch leaves it untyped
        return out


class ZeroInitLinear(nn.Linear):
    """A linear layer whose weights and bias are zero before training."""


class GraphConvolution(nn.Module):
    """``A X W + X U`` (supplement, equation 1, before its ReLU).

    As in DMGNN the adjacency is learnt: ``A * edge_mask + edge_offset``.

    Parameters
    ----------
    adjacency : (J, J), with a zero diagonal
    in_channels, out_channels : int
    """

    adjacency: Tensor

    def __init__(self, adjacency: Tensor, in_channels: int, out_channels: int) -> None:
        super().__init__()
        self.register_buffer("adjacency", adjacency, persistent=False)
        self.edge_mask = nn.Parameter(torch.ones_like(adjacency))
        self.edge_offset = nn.Parameter(torch.zeros_like(adjacency))
        self.neighbour_linear = nn.Linear(in_channels, out_channels, bias=False)  # W
        self.self_linear = nn.Linear(in_channels, out_channels)  # U

    def forward(self, x: Tensor) -> Tensor:
        """Map ``(T, J, ..., C)`` to ``(T, J, ..., C')``."""
        adjacency = self.adjacency * self.edge_mask + self.edge_offset
        neighbour, loop = self.neighbour_linear.weight, self.self_linear
        out: Tensor = GraphConvolutionFunction.apply(
            x, adjacency, neighbour, loop.weight, loop.bias
        )  # type: ignore[no-untyped-call]  # torch leaves it untyped
        return out


class TemporalConvolution(nn.Module):
    """A convolution over five frames, centred, with zero padding.

    Parameters
    ----------
    in_channels, out_channels : int
    stride : frames
    """

    def __init__(self, in_channels: int, out_channels: int, *, stride: int) -> None:
        super().__init__()
        self.stride = stride
        # The weight's columns are the channels of the kernel's frames, one frame after another.
        self.linear = nn.Linear(TEMPORAL_KERNEL * in_channels, out_channels)

    def forward(self, x: Tensor) -> Tensor:
        """Map ``(T, J, B, C)`` to ``(ceil(T / stride), J, B, C')``."""
        kernel = self.linear.weight.view(-1, TEMPORAL_KERNEL, x.shape[-1])
        out: Tensor = TemporalConvolutionFunction.apply(x, kernel, self.linear.bias, self.stride)  # type: ignore[no-untyped-call]  # torch leaves it untyped
        return out


class ChannelBatchNorm(nn.BatchNorm1d):
    """Batch normalisation of the last axis over all other axes."""

    def forward(self, x: Tensor, *, relu: bool = False) -> Tensor:
        """Map ``(..., C)`` to the same, optionally followed by a ReLU."""
        normalised = super().forward(x.reshape(-1, x.shape[-1]))
        # The ReLU precedes the view: in place on a view it would copy the gradient twice.
        return (normalised.relu_() if relu else normalised).view(x.shape)


class StGcnLayer(nn.Module):
    """Spatio-temporal graph convolution (ST-GCN): one layer (supplement, 3.1).

    Graph convolution, ReLU, batch norm, ReLU, temporal convolution, batch norm, dropout; residual
    connection and ReLU as in DMGNN, on which the supplement's layer is based. Where the shape
    changes, the residual is a 1 x 1 convolution; the first layer of a network has none.

    Parameters
    ----------
    adjacency : (J, J), with a zero diagonal
    in_channels, out_channels : int
    stride : frames
    dropout : probability
    residual : whether there is a residual connection
    """

    def __init__(
        self,
        adjacency: Tensor,
        in_channels: int,
        out_channels: int,
        *,
        stride: int,
        dropout: float,
        residual: bool,
    ) -> None:
        super().__init__()
        self.graph_conv = GraphConvolution(adjacency, in_channels, out_channels)
        self.norms = nn.ModuleList([ChannelBatchNorm(out_channels) for _ in range(2)])
        self.temporal_conv = TemporalConvolution(out_channels, out_channels, stride=stride)
        self.stride, self.dropout, self.residual = stride, dropout, residual
        self.final_relu = True
        same_shape = in_channels == out_channels and stride == 1
        self.shortcut: nn.Module = nn.Identity()
        if residual and not same_shape:
            self.shortcut = nn.Sequential(
                ConcatLinear(in_channels, out_channels), ChannelBatchNorm(out_channels)
            )

    def forward(self, x: Tensor, random: torch.Generator | None) -> Tensor:
        """Map ``(T, J, B, C)`` to ``(ceil(T / stride), J, B, C')``.

        Parameters
        ----------
        random : samples the dropout; without it there is none
        """
        # In place where torch allows it: these are the largest tensors of the network.
        spatial = self.norms[0](self.graph_conv(x).relu(), relu=True)
        relu = self.final_relu and not self.residual
        out: Tensor = self.norms[1](self.temporal_conv(spatial), relu=relu)
        out = dropout(out, self.dropout, random)
        if not self.residual:
            return out
        # The gradient of a slice of the whole tensor would take two passes over memory.
        out = out + self.shortcut(x if self.stride == 1 else x[:: self.stride])
        return out.relu_() if self.final_relu else out


def encoder_channels(hidden: int) -> tuple[int, ...]:
    """List the channels of the encoder's layers: 32, 64, 128, 256, 256 for ``hidden`` 256."""
    return (hidden // 8, hidden // 4, hidden // 2, hidden, hidden)


class StGcnEncoder(nn.Module):
    """ST-GCN1, 2 and 3: five layers, three of them of stride 2, and the mean over time.

    Supplement, tables 11, 13 and 14.

    Parameters
    ----------
    adjacency : (J, J), with a zero diagonal
    in_channels : int
    channels : of the five layers
    dropout : probability
    """

    def __init__(
        self, adjacency: Tensor, in_channels: int, channels: tuple[int, ...], *, dropout: float
    ) -> None:
        super().__init__()
        sizes = zip((in_channels, *channels[:-1]), channels, ENCODER_STRIDES, strict=True)
        self.layers = nn.ModuleList(
            [
                StGcnLayer(adjacency, a, b, stride=stride, dropout=dropout, residual=number > 0)
                for number, (a, b, stride) in enumerate(sizes)
            ]
        )

    def forward(self, x: Tensor, random: torch.Generator | None) -> Tensor:
        """Map ``(B, T, J, C)`` to ``(B, J, C')``."""
        x = frames_first(x)
        for layer in self.layers:
            x = layer(x, random)
        return to_float32(x).mean(dim=0).transpose(0, 1)


class GraphGru(nn.Module):
    """The graph gated recurrent unit (G-GRU).

    With the message ``M = A H W``::

        r  = sigmoid(r_in(x) + r_hid(M))
        u  = sigmoid(u_in(x) + u_hid(M))
        c  = tanh(c_in(x) + r * c_hid(M))
        H' = u * H + (1 - u) * c

    Unlike the supplement's equation 2, the sums are inside the sigmoid, as in DMGNN, and all
    products are elementwise. One message serves all gates.

    Parameters
    ----------
    adjacency : (J, J), including self-loops
    in_channels, hidden : int
    """

    adjacency: Tensor

    def __init__(self, adjacency: Tensor, in_channels: int, hidden: int) -> None:
        super().__init__()
        self.register_buffer("adjacency", adjacency)
        self.hidden = hidden
        self.edge_mask = nn.Parameter(torch.ones_like(adjacency))
        self.edge_offset = nn.Parameter(torch.zeros_like(adjacency))
        self.message = nn.Linear(hidden, hidden, bias=False)
        self.gates_in = nn.Linear(in_channels, 3 * hidden)  # reset, update, candidate
        self.gates_hidden = nn.Linear(hidden, 3 * hidden, bias=False)

    def folded_weights(self) -> tuple[Tensor, Tensor]:
        """Compute the learnt adjacency (J, J), and message times gate weights (h, 3h)."""
        message_weight = self.message.weight.T @ self.gates_hidden.weight.T
        return self.adjacency * self.edge_mask + self.edge_offset, message_weight

    def step(self, weights: tuple[Tensor, Tensor], inputs: Tensor, state: Tensor) -> Tensor:
        """Advance the state by one frame, joints first.

        Parameters
        ----------
        weights : of ``folded_weights``
        inputs : (J, B, 3h), the input after ``gates_in``
        state : (J, B, h)

        Returns
        -------
        (J, B, h)
        """
        adjacency, message_weight = weights
        n_joints, n_rows, hidden = state.shape
        mixed = adjacency @ state.reshape(n_joints, -1)
        message = (mixed.view(-1, hidden) @ message_weight).view(n_joints, n_rows, 3 * hidden)
        gates = torch.sigmoid(inputs[..., : 2 * hidden] + message[..., : 2 * hidden])
        reset, update = gates[..., :hidden], gates[..., hidden:]
        candidate = torch.tanh(
            torch.addcmul(inputs[..., 2 * hidden :], reset, message[..., 2 * hidden :])
        )
        return torch.lerp(candidate, state, update)

    def forward(self, x: Tensor, state: Tensor) -> Tensor:
        """Run over a known input sequence.

        Parameters
        ----------
        x : (T, J, B, C)
        state : (J, B, h), before the first frame

        Returns
        -------
        (T, J, B, h), the state after each frame
        """
        gates_in, needs_gradients = self.gates_in, torch.is_grad_enabled()
        inputs = gates_in.weight, gates_in.bias, needs_gradients
        states: Tensor = GraphGruFunction.apply(x, state, *self.folded_weights(), *inputs)  # type: ignore[no-untyped-call]  # torch leaves it untyped
        return states


class OutputHead(nn.Module):
    """Three linear layers with leaky ReLU between them (supplement, tables 12 and 16).

    Parameters
    ----------
    hidden, out_channels : int
    last : class of the last layer
    """

    def __init__(self, hidden: int, out_channels: int, last: type[nn.Linear] = nn.Linear) -> None:
        super().__init__()
        self.layers = nn.ModuleList(
            [ConcatLinear(hidden, hidden), ConcatLinear(hidden, hidden), last(hidden, out_channels)]
        )

    def forward(self, *parts: Tensor) -> Tensor:
        """Map ``(..., h)``, in one or several tensors side by side, to ``(..., C)``."""
        first, second, last = self.layers
        x = second(nn.functional.leaky_relu(first(*parts), LEAKY_SLOPE))
        out: Tensor = last(to_float32(nn.functional.leaky_relu(x, LEAKY_SLOPE)))
        return out


class JointConvolution(nn.Module):
    """A convolution over three consecutive joints, and ReLU.

    Parameters
    ----------
    in_channels, out_channels : int
    """

    def __init__(self, in_channels: int, out_channels: int) -> None:
        super().__init__()
        self.linear = ConcatLinear(JOINT_KERNEL * in_channels, out_channels)

    def forward(self, x: Tensor) -> Tensor:
        """Map ``(..., J, C)`` to ``(..., J, C')``."""
        padded = nn.functional.pad(x, (0, 0, 1, 1))
        n = x.shape[-2]
        neighbours = torch.cat([padded[..., i : i + n, :] for i in range(JOINT_KERNEL)], dim=-1)
        out: Tensor = to_float32(self.linear(neighbours))
        return out.relu()


class JointTransposedConvolution(nn.Module):
    """A transposed convolution of kernel 3, stride 2 and padding 1, and ReLU: J to 2 J - 1 joints.

    Parameters
    ----------
    in_channels, out_channels : int
    """

    def __init__(self, in_channels: int, out_channels: int) -> None:
        super().__init__()
        self.linear = ConcatLinear(JOINT_KERNEL * in_channels, out_channels)

    def forward(self, x: Tensor, n_joints: int) -> Tensor:
        """Map ``(..., J, C)`` to 2 J - 1 joints, or 2 J with the last one repeated."""
        upsampled = x.new_zeros(*x.shape[:-2], 2 * x.shape[-2] + 1, x.shape[-1])
        upsampled[..., 1:-1:2, :] = x
        n = 2 * x.shape[-2] - 1
        neighbours = torch.cat([upsampled[..., i : i + n, :] for i in range(JOINT_KERNEL)], dim=-1)
        out: Tensor = to_float32(self.linear(neighbours)).relu()
        if n_joints > n:
            out = torch.cat([out, out[..., -1:, :]], dim=-2)
        return out


class FrameJointConvolution(nn.Module):
    """A convolution over three frames and three consecutive joints.

    At stride 1 it is a transposed convolution too.

    Parameters
    ----------
    in_channels, out_channels : int
    """

    def __init__(self, in_channels: int, out_channels: int) -> None:
        super().__init__()
        self.linear = ConcatLinear(JOINT_KERNEL * JOINT_KERNEL * in_channels, out_channels)

    def forward(self, x: Tensor) -> Tensor:
        """Map ``(B, T, J, C)`` to ``(B, T, J, C')``."""
        n_frames, n_joints = x.shape[1:3]
        padded = nn.functional.pad(x, (0, 0, 1, 1, 1, 1))
        neighbours = [
            padded[:, frame : frame + n_frames, joint : joint + n_joints]
            for frame in range(JOINT_KERNEL)
            for joint in range(JOINT_KERNEL)
        ]
        out: Tensor = to_float32(self.linear(torch.cat(neighbours, dim=-1)))
        return out


def max_pool_frames(x: Tensor) -> Tensor:
    """Max-pool ``(B, T, J, C)`` over three frames with stride 1."""
    padded = torch.cat([x[:, :1], x, x[:, -1:]], dim=1)
    return torch.maximum(torch.maximum(padded[:, :-2], padded[:, 1:-1]), padded[:, 2:])


def max_pool_joints(x: Tensor) -> Tensor:
    """Max-pool pairs of joints ``(..., J, C)``: to ``(..., ceil(J / 2), C)``."""
    return _joint_pairs(x).amax(dim=-2)


def mean_pool_joints(x: Tensor) -> Tensor:
    """Average pairs of joints ``(..., J, C)``: to ``(..., ceil(J / 2), C)``."""
    return _joint_pairs(x).mean(dim=-2)


def _joint_pairs(x: Tensor) -> Tensor:
    if x.shape[-2] % 2:
        x = torch.cat([x, x[..., -1:, :]], dim=-2)
    return x.reshape(*x.shape[:-2], -1, 2, x.shape[-1])


def frames_first(x: Tensor) -> Tensor:
    """Map ``(B, T, J, C)`` to ``(T, J, B, C)``, contiguous."""
    return x.permute(1, 2, 0, 3).contiguous()


def batch_first(x: Tensor) -> Tensor:
    """Map ``(T, J, B, C)`` to ``(B, T, J, C)``."""
    return x.permute(2, 0, 1, 3)


def dropout(x: Tensor, probability: float, random: torch.Generator | None) -> Tensor:
    """Apply dropout with an explicit generator; none without a generator."""
    if random is None or not probability:
        return x
    mask = torch.empty(x.shape, device="cpu").bernoulli_(1 - probability, generator=random)
    return x * (mask.to(x.device) / (1 - probability))


# Layers whose own parameters keep the constructor's values: ones and zeros.
CONSTANT_INITIALISED = (GraphConvolution, GraphGru, nn.BatchNorm1d)


def initialise_weights(module: nn.Module, random: torch.Generator) -> None:
    """Initialise all weights of a module, in order, from an explicit generator.

    Linear layers are uniform within +-1 / sqrt(fan-in), as torch initialises them from its global
    generator.

    Raises
    ------
    ValueError
        If a layer is of an unknown class.
    """
    for layer in module.modules():
        if isinstance(layer, ZeroInitLinear):
            nn.init.zeros_(layer.weight)
            nn.init.zeros_(layer.bias)
        elif isinstance(layer, nn.Linear):
            bound = 1 / math.sqrt(math.prod(layer.weight.shape[1:]))
            with torch.no_grad():
                for weight in layer.parameters(recurse=False):
                    values = torch.empty(weight.shape).uniform_(-bound, bound, generator=random)
                    weight.copy_(values)
        elif isinstance(layer, CONSTANT_INITIALISED):
            continue
        elif next(layer.parameters(recurse=False), None) is not None:
            raise ValueError(f"no initialisation for layers of class {type(layer).__name__}")
