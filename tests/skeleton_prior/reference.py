"""The networks once more, plainly: loops over frames and joints, one layer a gate, nothing folded.

Tensors are ``(B, T, J, C)`` throughout, as batches come.

The oracle of the tests, and what the benchmark compares with.
"""

from collections.abc import Iterable

import torch
from torch import Tensor, nn

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.skeleton_prior.kinematics import KinematicOutput, Limb
from pacmo_core.skeleton_prior.layers import (
    LEAKY_SLOPE,
    TEMPORAL_KERNEL,
    GraphConvolution,
    GraphGru,
    OutputHead,
    StGcnEncoder,
    StGcnLayer,
    TemporalConvolution,
)
from pacmo_core.skeleton_prior.models.kinematic import KinematicDecoder, KinematicVae
from pacmo_core.skeleton_prior.vae import SkeletonPrior


def dense(layer: nn.Module, x: Tensor) -> Tensor:
    """Weigh channels by a dense layer's weights, with torch's own product."""
    weights = dict(layer.named_parameters())
    return nn.functional.linear(x, weights["weight"], weights.get("bias"))


def graph_convolution(layer: GraphConvolution, x: Tensor) -> Tensor:
    """Sum over the joints' links one by one, (J, C) of one frame."""
    weights = layer.adjacency * layer.edge_mask + layer.edge_offset
    rows = []
    for joint in range(len(x)):
        total = layer.self_linear.weight @ x[joint] + layer.self_linear.bias
        for other in range(len(x)):
            total = total + weights[joint, other] * (layer.neighbour_linear.weight @ x[other])
        rows.append(total)
    return torch.stack(rows)


def norm(layer: nn.Module, x: Tensor) -> Tensor:
    """Normalise by running statistics, channel by channel."""
    kept = layer.state_dict()
    scaled = (x - kept["running_mean"]) / (kept["running_var"] + 1e-5).sqrt()
    normed: Tensor = scaled * kept["weight"] + kept["bias"]
    return normed


def st_gcn(layer: StGcnLayer, x: Tensor) -> Tensor:
    """Run one row (T, J, C) through a layer in evaluation."""
    frames = torch.stack([graph_convolution(layer.graph_conv, frame) for frame in x]).relu()
    frames = norm(layer.norms[0], frames).relu()
    kernel = layer.temporal_conv.linear.weight.view(frames.shape[-1], 5, frames.shape[-1])
    rows = []
    for centre in range(0, len(x), layer.stride):
        total = layer.temporal_conv.linear.bias.expand(frames.shape[1:])
        for shift in range(5):
            frame = centre + shift - 2
            if 0 <= frame < len(x):
                total = total + frames[frame] @ kernel[:, shift].T
        rows.append(total)
    out = norm(layer.norms[1], torch.stack(rows))
    if layer.residual:
        short = x[:: layer.stride]
        if isinstance(layer.shortcut, nn.Sequential):
            short = norm(layer.shortcut[1], layer.shortcut[0](short))
        out = out + short
    return out.relu() if layer.final_relu else out


class ReferenceGru(nn.Module):
    """The G-GRU as its equations stand: six layers and a message, frame by frame.

    Parameters
    ----------
    fused : whose weights it takes
    """

    def __init__(self, fused: GraphGru) -> None:
        super().__init__()
        self.register_buffer(
            "links", (fused.adjacency * fused.edge_mask + fused.edge_offset).detach()
        )
        hidden = fused.hidden
        self.message = nn.Linear(hidden, hidden, bias=False)
        self.message.load_state_dict(fused.message.state_dict())
        self.into = _gates(fused.gates_in, hidden)
        self.hidden = _gates(fused.gates_hidden, hidden)

    def step(self, x: Tensor, state: Tensor) -> Tensor:
        """One frame, (B, J, C) and (B, J, h)."""
        message = self.message(torch.einsum("ij,bjh->bih", self.links, state))
        reset = torch.sigmoid(self.into[0](x) + self.hidden[0](message))
        update = torch.sigmoid(self.into[1](x) + self.hidden[1](message))
        candidate = torch.tanh(self.into[2](x) + reset * self.hidden[2](message))
        return update * state + (1 - update) * candidate

    def forward(self, x: Tensor, state: Tensor) -> Tensor:
        """Run over (B, T, J, C)."""
        states = []
        for frame in range(x.shape[1]):
            state = self.step(x[:, frame], state)
            states.append(state)
        return torch.stack(states, dim=1)


class ReferenceHead(nn.Module):
    """The head, frame by frame."""

    def __init__(self, head: OutputHead) -> None:
        super().__init__()
        self.head = head

    def forward(self, x: Tensor) -> Tensor:
        """Run over (B, T, J, C)."""
        return torch.stack([self._frame(x[:, frame]) for frame in range(x.shape[1])], dim=1)

    def _frame(self, x: Tensor) -> Tensor:
        for layer in self.head.layers[:-1]:
            x = nn.functional.leaky_relu(dense(layer, x), LEAKY_SLOPE)
        return dense(self.head.layers[-1], x)


def _gates(fused: nn.Linear, hidden: int) -> nn.ModuleList:
    parts = []
    for number in range(3):
        rows = slice(number * hidden, (number + 1) * hidden)
        part = nn.Linear(fused.in_features, hidden, bias=fused.bias is not None)
        state = {"weight": fused.weight[rows].detach()}
        if fused.bias is not None:
            state["bias"] = fused.bias[rows].detach()
        part.load_state_dict(state)
        parts.append(part)
    return nn.ModuleList(parts)


class ReferenceConvolution(nn.Module):
    """A graph convolution frame by frame, as its equation stands.

    Parameters
    ----------
    folded : whose weights it takes
    """

    def __init__(self, folded: GraphConvolution) -> None:
        super().__init__()
        self.folded = folded

    def forward(self, x: Tensor) -> Tensor:
        """Run over (B, T, J, C)."""
        links = self.folded.adjacency * self.folded.edge_mask + self.folded.edge_offset
        frames = [
            self.folded.neighbour_linear(torch.einsum("ij,bjc->bic", links, x[:, frame]))
            + self.folded.self_linear(x[:, frame])
            for frame in range(x.shape[1])
        ]
        return torch.stack(frames, dim=1)


class ReferenceTime(nn.Module):
    """A convolution of five frames by torch's own of two dimensions, one of them a single joint.

    Parameters
    ----------
    folded : whose weights it takes
    """

    def __init__(self, folded: TemporalConvolution) -> None:
        super().__init__()
        weight = folded.linear.weight.detach()
        width, around = len(weight), (TEMPORAL_KERNEL, 1)
        channels = weight.shape[1] // TEMPORAL_KERNEL
        padding, stride = (TEMPORAL_KERNEL // 2, 0), (folded.stride, 1)
        self.convolution = nn.Conv2d(channels, width, around, stride=stride, padding=padding)
        kernel = weight.view(width, TEMPORAL_KERNEL, channels).transpose(1, 2)[..., None]
        own = {"weight": kernel.contiguous(), "bias": folded.linear.bias.detach()}
        self.convolution.load_state_dict(own)

    def forward(self, x: Tensor) -> Tensor:
        """Run over (B, T, J, C)."""
        out: Tensor = self.convolution(x.permute(0, 3, 1, 2)).permute(0, 2, 3, 1)
        return out


class ReferenceStGcn(nn.Module):
    """An ST-GCN layer, one operation after the other.

    Parameters
    ----------
    folded : whose weights it takes
    """

    def __init__(self, folded: StGcnLayer) -> None:
        super().__init__()
        self.folded = folded
        self.graph, self.time = (
            ReferenceConvolution(folded.graph_conv),
            ReferenceTime(folded.temporal_conv),
        )

    def forward(self, x: Tensor) -> Tensor:
        """Run over (B, T, J, C), nothing dropped."""
        before, after = self.folded.norms
        out: Tensor = after(self.time(before(self.graph(x).relu()).relu()))
        if self.folded.residual:
            out = out + self._short(x[:, :: self.folded.stride])
        return out.relu() if self.folded.final_relu else out

    def _short(self, x: Tensor) -> Tensor:
        if not isinstance(self.folded.shortcut, nn.Sequential):
            return x
        layer, after = self.folded.shortcut
        out: Tensor = after(dense(layer, x))
        return out


def _plain(layers: Iterable[nn.Module]) -> nn.ModuleList:
    return nn.ModuleList(
        [ReferenceStGcn(layer) for layer in layers if isinstance(layer, StGcnLayer)]
    )


class ReferenceEncoder(nn.Module):
    """The encoder of plain layers.

    Parameters
    ----------
    folded : whose weights it takes
    """

    def __init__(self, folded: StGcnEncoder) -> None:
        super().__init__()
        self.layers = _plain(folded.layers)

    def forward(self, x: Tensor, random: torch.Generator | None) -> Tensor:
        """``(B, T, J, C)`` to ``(B, J, C')``, nothing dropped."""
        del random
        for layer in self.layers:
            x = layer(x)
        return x.mean(dim=1)


class ReferenceDecoder(nn.Module):
    """The decoder of our form of plain layers.

    Parameters
    ----------
    folded : whose weights it takes
    """

    def __init__(self, folded: KinematicDecoder) -> None:
        super().__init__()
        self.folded = folded
        self.around = _plain(folded.st_gcn)
        self.recurrent, self.head = ReferenceGru(folded.gru), ReferenceHead(folded.head)

    def forward(self, sights: Tensor, latent: Tensor) -> Tensor:
        """``(B, T, J, 30)`` and ``(B, J, h)`` to ``(B, T, J, 3)``."""
        known = self.folded.feature_norm(sights)
        seen = dense(self.folded.joint_linear, known)
        seen = seen + dense(self.folded.mean_linear, known.mean(dim=2, keepdim=True))
        for layer in self.around:
            seen = layer(seen)
        field: Tensor = self.head(torch.cat([self.recurrent(seen, latent), seen], dim=-1))
        return field


class ReferenceKinematics(KinematicOutput):
    """Forward kinematics joint by joint, each from its parent.

    Parameters
    ----------
    skeleton : Skeleton
    limbs : its arms and legs
    """

    def __init__(self, skeleton: Skeleton, limbs: tuple[Limb, ...]) -> None:
        super().__init__(skeleton, limbs)
        self.skeleton = skeleton

    def _joint_positions(self, bones: Tensor, root: Tensor) -> Tensor:
        places = {self.root: root}
        for joint in self.skeleton.order:
            if joint != self.root:
                places[joint] = places[self.skeleton.parents[joint]] + bones[..., joint, :]
        return torch.stack([places[joint] for joint in range(len(places))], dim=-2)


def make_reference(model: SkeletonPrior) -> SkeletonPrior:
    """Write a network of our form plainly, in place, its weights kept."""
    model.tree = ReferenceKinematics(model.config.skeleton, model.config.limbs)
    for character in (model.first, model.second):
        if not isinstance(character, KinematicVae):
            raise TypeError(f"wanted our form; got {type(character).__name__}")
        parts = {
            "tree": model.tree,
            "place": model.tree,
            "encoder": ReferenceEncoder(character.encoder),
            "decoder": ReferenceDecoder(character.decoder),
        }
        for name, part in parts.items():
            character.add_module(name, part)
    return model
