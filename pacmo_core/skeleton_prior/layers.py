"""A skeleton as the graph that convolutions run on, and as the tree that places its joints."""

import math
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.skeleton_prior.autograd_functions import (
    GraphConvolutionFunction,
    LinearFunction,
    TemporalConvolutionFunction,
    add_linear,
    cast_factor,
    linear,
    to_float32,
    weight_gradient,
)


def adjacency(skeleton: Skeleton) -> Tensor:
    """``(J, J)`` float32: ``A D⁻¹`` of the bones and of each joint with itself; columns sum to 1.

    Li et al. (2020), *Dynamic multiscale graph neural networks*, normalise so.
    """
    links = np.eye(len(skeleton.joints))
    parent, child = skeleton.bones.T
    links[parent, child] = links[child, parent] = 1
    return torch.tensor(links / links.sum(axis=0), dtype=torch.float32)


def off_diagonal_adjacency(skeleton: Skeleton) -> Tensor:
    """``(J, J)`` float32: the part of ``adjacency`` off its diagonal: what comes along a bone."""
    links = adjacency(skeleton)
    return links - torch.diag(links.diagonal())


# FROM """Graph convolution in space and time, and what else all networks are made of.
# FROM
# FROM Tensors are ``(T, J, B, C)``: time, joint, batch, channel. So channels are one product of matrices,
# FROM joints one a frame, wide enough for the processor, and a recurrence finds each frame in one piece.
# FROM
# FROM Where factors are rounded (``products``), so is what layers of these give, until it is ``exact``.
# FROM """
TEMPORAL_KERNEL = 5
LEAKY_SLOPE = 0.1


class ConcatLinear(nn.Linear):
    """A dense layer on channels, which may come in several parts."""

    def forward(self, *parts: Tensor) -> Tensor:
        """``(..., C1)``, ``(..., C2)``, ... to ``(..., D)``."""
        out: Tensor = LinearFunction.apply(self.weight, self.bias, *parts)  # type: ignore[no-untyped-call]  # torch leaves it untyped
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
        out: Tensor = GraphConvolutionFunction.apply(
            x, weights, self.along.weight, own.weight, own.bias
        )  # type: ignore[no-untyped-call]  # torch leaves it untyped
        return out


class TemporalConvolution(nn.Module):
    """A convolution of five frames, centred; what is beyond the ends is zero.

    Parameters
    ----------
    in_channels, out_channels : int
    stride : frames in to one out
    """

    def __init__(self, in_channels: int, out_channels: int, *, stride: int) -> None:
        super().__init__()
        self.stride = stride
        self.weigh = nn.Linear(
            TEMPORAL_KERNEL * in_channels, out_channels
        )  # the frames one after another

    def forward(self, x: Tensor) -> Tensor:
        """``(T, J, B, C)`` to ``(ceil(T / stride), J, B, C')``."""
        kernel = self.weigh.weight.view(-1, TEMPORAL_KERNEL, x.shape[-1])
        out: Tensor = TemporalConvolutionFunction.apply(x, kernel, self.weigh.bias, self.stride)  # type: ignore[no-untyped-call]  # torch leaves it untyped
        return out


class ChannelBatchNorm(nn.BatchNorm1d):
    """Batch normalisation of the last axis over all others."""

    def forward(self, x: Tensor, *, active: bool = False) -> Tensor:
        """``(..., C)`` to the same; ``active``: through a ReLU.

        Done in place on a view, it would copy the whole gradient twice.
        """
        normed = super().forward(x.reshape(-1, x.shape[-1]))
        return (normed.relu_() if active else normed).view(x.shape)


class StGcnLayer(nn.Module):
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
        self.norms = nn.ModuleList([ChannelBatchNorm(out_channels) for _ in range(2)])
        self.time = TemporalConvolution(out_channels, out_channels, stride=stride)
        self.stride, self.dropout, self.residual = stride, dropout, residual
        self.active = True  # whether the last ReLU is there
        same = in_channels == out_channels and stride == 1
        self.shortcut: nn.Module = nn.Identity()
        if residual and not same:
            self.shortcut = nn.Sequential(
                ConcatLinear(in_channels, out_channels), ChannelBatchNorm(out_channels)
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
        out = dropout(out, self.dropout, random)
        if not self.residual:
            return out
        # A slice of everything would cost its gradient two passes over memory.
        out = out + self.shortcut(x if self.stride == 1 else x[:: self.stride])
        return out.relu_() if self.active else out


class ZeroInitLinear(nn.Linear):
    """A dense layer that says nothing before it has learnt: its weights begin at zero."""


class OutputHead(nn.Module):
    """Three dense layers with leaky ReLU between them (supplement, tables 12 and 16).

    Parameters
    ----------
    hidden, out_channels : int
    last : the kind of the last layer
    """

    def __init__(self, hidden: int, out_channels: int, last: type[nn.Linear] = nn.Linear) -> None:
        super().__init__()
        self.layers = nn.ModuleList(
            [ConcatLinear(hidden, hidden), ConcatLinear(hidden, hidden), last(hidden, out_channels)]
        )

    def forward(self, *parts: Tensor) -> Tensor:
        """``(..., h)``, in one part or several, to ``(..., C)``."""
        first, second, last = self.layers
        x = second(nn.functional.leaky_relu(first(*parts), LEAKY_SLOPE))
        out: Tensor = last(to_float32(nn.functional.leaky_relu(x, LEAKY_SLOPE)))
        return out


def frames_first(x: Tensor) -> Tensor:
    """``(B, T, J, C)`` to ``(T, J, B, C)``, as the layers take it."""
    return x.permute(1, 2, 0, 3).contiguous()


def batch_first(x: Tensor) -> Tensor:
    """``(T, J, B, C)`` back to ``(B, T, J, C)``."""
    return x.permute(2, 0, 1, 3)


def dropout(x: Tensor, share: float, random: torch.Generator | None) -> Tensor:
    """Set a share of the values to zero and raise the others, by an explicit generator."""
    if random is None or not share:
        return x
    kept = torch.empty(x.shape, device="cpu").bernoulli_(1 - share, generator=random)
    return x * (kept.to(x.device) / (1 - share))


# FROM """Convolutions over joints in a row, as if a body were a line: parts of the CNN baselines."""
JOINT_KERNEL = 3


class JointConvolution(nn.Module):
    """A convolution over three joints in their order, and ReLU; products of matrices, as in layers.

    Parameters
    ----------
    in_channels, out_channels : int
    """

    def __init__(self, in_channels: int, out_channels: int) -> None:
        super().__init__()
        self.weigh = ConcatLinear(JOINT_KERNEL * in_channels, out_channels)

    def forward(self, x: Tensor) -> Tensor:
        """``(..., J, C)`` to the same with other channels."""
        padded = nn.functional.pad(x, (0, 0, 1, 1))
        n = x.shape[-2]
        around = torch.cat([padded[..., i : i + n, :] for i in range(3)], dim=-1)
        out: Tensor = to_float32(self.weigh(around))
        return out.relu()


class JointTransposedConvolution(nn.Module):
    """A transposed convolution of kernel 3, stride 2 and padding 1, and ReLU: J to 2 J - 1 joints.

    An odd joint is the even kernel's; an even one takes the outer two of its neighbours.

    Parameters
    ----------
    in_channels, out_channels : int
    """

    def __init__(self, in_channels: int, out_channels: int) -> None:
        super().__init__()
        self.weigh = ConcatLinear(JOINT_KERNEL * in_channels, out_channels)

    def forward(self, x: Tensor, n_joints: int) -> Tensor:
        """``(..., J, C)`` to ``(..., n_joints, C')``: 2 J - 1, or with the last one twice 2 J."""
        spread = x.new_zeros(*x.shape[:-2], 2 * x.shape[-2] + 1, x.shape[-1])
        spread[..., 1:-1:2, :] = x
        n = 2 * x.shape[-2] - 1
        around = torch.cat([spread[..., i : i + n, :] for i in range(3)], dim=-1)
        out: Tensor = to_float32(self.weigh(around)).relu()
        if n_joints > n:
            out = torch.cat([out, out[..., -1:, :]], dim=-2)
        return out


class FrameJointConvolution(nn.Module):
    """A convolution over three frames and three joints in their order.

    With stride 1 a transposed convolution is one too.

    Parameters
    ----------
    in_channels, out_channels : int
    """

    def __init__(self, in_channels: int, out_channels: int) -> None:
        super().__init__()
        self.weigh = ConcatLinear(JOINT_KERNEL * JOINT_KERNEL * in_channels, out_channels)

    def forward(self, x: Tensor) -> Tensor:
        """``(B, T, J, C)`` to the same with other channels."""
        n_frames, n_joints = x.shape[1:3]
        padded = nn.functional.pad(x, (0, 0, 1, 1, 1, 1))
        around = [
            padded[:, frame : frame + n_frames, joint : joint + n_joints]
            for frame in range(JOINT_KERNEL)
            for joint in range(JOINT_KERNEL)
        ]
        out: Tensor = to_float32(self.weigh(torch.cat(around, dim=-1)))
        return out


def max_pool_frames(x: Tensor) -> Tensor:
    """Pool ``(B, T, J, C)`` over three frames with stride 1: the most of them."""
    padded = torch.cat([x[:, :1], x, x[:, -1:]], dim=1)
    return torch.maximum(torch.maximum(padded[:, :-2], padded[:, 1:-1]), padded[:, 2:])


def pool_joint_pairs(x: Tensor, *, most: bool) -> Tensor:
    """Halve the joints ``(..., J, C)``, the larger half: the most of two, or their mean."""
    if x.shape[-2] % 2:
        x = torch.cat([x, x[..., -1:, :]], dim=-2)
    pairs = x.reshape(*x.shape[:-2], -1, 2, x.shape[-1])
    return pairs.amax(dim=-2) if most else pairs.mean(dim=-2)


# FROM """The graph gated recurrent unit: over a sequence that is all known, or step by step."""
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
        x : (T, J, B, C)
        state : (J, B, h), before the first frame

        Returns
        -------
        (T, J, B, h), the states after each frame
        """
        links, folded = self.weights()
        into = self.gates_in
        keeps = torch.is_grad_enabled()  # which a Function is not told
        states: Tensor = GraphGruFunction.apply(
            x, state, links, folded, into.weight, into.bias, keeps
        )  # type: ignore[no-untyped-call]  # torch leaves it untyped
        return states


class GraphGruFunction(torch.autograd.Function):
    """All steps of a ``GraphGru``, and their gradients in one loop backwards.

    What a frame needs is made, used and summed up while it is in the processor's cache: to fetch
    tensors of all frames from memory, one for each gate, would take longer than to multiply them.
    """

    @staticmethod
    def forward(  # noqa: PLR0913  # autograd wants its tensors one by one
        ctx: Any,
        x: Tensor,
        start: Tensor,
        links: Tensor,
        folded: Tensor,
        told: Tensor,
        bias: Tensor,
        keeps: bool,
    ) -> Tensor:
        """Run from a state: ``(T, J, B, C)`` and ``(J, B, h)`` to states ``(T, J, B, h)``.

        Parameters
        ----------
        links, folded : as ``GraphGru.weights`` has them
        told, bias : (3h, C) and (3h,), of what comes in
        keeps : whether to keep of each frame what gradients need
        """
        x = cast_factor(x)
        n_frames, n_joints, n_rows, hidden = len(x), *start.shape
        states = start.new_empty(n_frames + 1, n_joints, n_rows, hidden)
        states[0] = start
        mixed = torch.empty_like(start)
        parts = torch.split(folded.T, [2 * hidden, hidden])
        to_gates, to_candidate = (part.contiguous() for part in parts)
        # Of each frame: reset, update and candidate; what the candidate hears through the reset.
        all_opened, all_heard = [], []
        for frame in range(n_frames):
            state = states[frame]
            torch.mm(links, state.flatten(1), out=mixed.flatten(1))
            message = mixed.to(x.dtype)
            opened, heard = linear(x[frame], told, bias), linear(message, to_candidate)
            both, candidate = opened[..., : 2 * hidden], opened[..., 2 * hidden :]
            add_linear(both, message, to_gates)
            both.sigmoid_()
            candidate.addcmul_(both[..., :hidden], heard)
            # tanh x = 2 s(2x) - 1: torch's own takes six times as long.
            candidate.mul_(2).sigmoid_().mul_(2).sub_(1)
            torch.lerp(candidate, state, both[..., hidden:], out=states[frame + 1])
            if keeps:
                all_opened.append(opened)
                all_heard.append(heard)
        ctx.save_for_backward(x, links, folded, told, states, *all_opened, *all_heard)
        return states[1:]

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        """Give the gradients of all six tensors."""
        x, links, folded, told, states, *kept = ctx.saved_tensors
        all_opened, all_heard = kept[: len(x)], kept[len(x) :]
        gradient, hidden = gradients[0].contiguous(), states.shape[-1]
        d_x, carried = torch.empty_like(x), torch.zeros_like(states[0])
        weights = links, folded, told, told[:, 0]
        d_links, d_folded, d_told, d_bias = (torch.zeros_like(each) for each in weights)
        # Of what comes in, and of what is heard: but for the candidate's part the same.
        d_in, d_heard, mixed = (torch.empty_like(each) for each in (kept[0], kept[0], carried))
        for frame in reversed(range(len(gradient))):
            state, opened, heard = states[frame], all_opened[frame], all_heard[frame]
            both, candidate = opened[..., : 2 * hidden], opened[..., 2 * hidden :]
            reset, update = both[..., :hidden], both[..., hidden:]
            total = carried.add_(gradient[frame])
            through = torch.addcmul(total, total, update, value=-1)
            d_candidate = torch.ops.aten.tanh_backward(through, candidate)
            torch.mul(d_candidate, heard, out=d_in[..., :hidden])
            torch.mul(total, state - candidate, out=d_in[..., hidden : 2 * hidden])
            d_both = d_in[..., : 2 * hidden]
            torch.ops.aten.sigmoid_backward.grad_input(d_both, both, grad_input=d_both)
            d_heard[..., : 2 * hidden] = d_both
            torch.mul(d_candidate, reset, out=d_heard[..., 2 * hidden :])
            d_in[..., 2 * hidden :] = d_candidate
            in_factor, heard_factor = d_in.to(x.dtype), d_heard.to(x.dtype)
            d_x[frame] = linear(in_factor, told.T)
            d_told += weight_gradient(in_factor, x[frame])
            d_bias += d_in.sum(dim=(0, 1))
            torch.mm(links, state.flatten(1), out=mixed.flatten(1))
            d_folded += weight_gradient(mixed, heard_factor)
            d_mixed = linear(heard_factor, folded).flatten(1)
            d_links.addmm_(d_mixed, state.flatten(1).T)
            carried.mul_(update).flatten(1).addmm_(links.T, d_mixed)
        return d_x, carried, d_links, d_folded, d_told, d_bias, None


# FROM """ST-GCN1, 2 and 3: a motion as one code a joint (supplement, tables 11, 13, 14 and 15)."""
ENCODER_STRIDES = (1, 2, 2, 2, 1)


def encoder_channels(hidden: int) -> tuple[int, ...]:
    """Channels of the five layers, 32 to 256 in the paper's size; the last two are alike."""
    return (hidden // 8, hidden // 4, hidden // 2, hidden, hidden)


class StGcnEncoder(nn.Module):
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
        pairs = zip((in_channels, *channels[:-1]), channels, ENCODER_STRIDES, strict=True)
        self.layers = nn.ModuleList(
            [
                StGcnLayer(
                    links, before, after, stride=stride, dropout=dropout, residual=number > 0
                )
                for number, (before, after, stride) in enumerate(pairs)
            ]
        )

    def forward(self, x: Tensor, random: torch.Generator | None) -> Tensor:
        """``(B, T, J, C)`` to ``(B, J, C')``."""
        x = frames_first(x)
        for layer in self.layers:
            x = layer(x, random)
        return to_float32(x).mean(dim=0).transpose(0, 1)


def end_poses(template: Tensor) -> Tensor:
    """``(B, J, 6)``: the first and the last pose of a template, metres."""
    return torch.cat([template[:, 0], template[:, -1]], dim=-1)


def scale_offsets(scales: Tensor, n_frames: int) -> Tensor:
    """``(B, J)`` to ``(B, T, J, 1)``, less 1: how much each bone grows."""
    return (scales - 1)[:, None, :, None].expand(-1, n_frames, -1, -1)


# FROM """Fresh weights from an explicit generator: torch's own constructors draw from a global one."""
# Weights that start where their constructor puts them: at the identity.
IDENTITY_INITIALISED = (GraphConvolution, GraphGru, nn.BatchNorm1d)


def initialise_weights(module: nn.Module, random: torch.Generator) -> None:
    """Draw anew, in order, all weights below ``module``, by the laws that torch's layers use.

    Raises
    ------
    ValueError
        If a layer with weights of its own is of a kind that this function does not know.
    """
    for layer in module.modules():
        if isinstance(layer, ZeroInitLinear):
            nn.init.zeros_(layer.weight)
            nn.init.zeros_(layer.bias)
        elif isinstance(layer, nn.Linear):
            bound = 1 / math.sqrt(math.prod(layer.weight.shape[1:]))
            with torch.no_grad():
                for weight in layer.parameters(recurse=False):
                    drawn = torch.empty(weight.shape).uniform_(-bound, bound, generator=random)
                    weight.copy_(drawn)
        elif isinstance(layer, IDENTITY_INITIALISED):
            continue
        elif next(layer.parameters(recurse=False), None) is not None:
            raise ValueError(f"no law for the weights of {type(layer).__name__}")
