"""Reference implementation of the kinematic model: loops over frames and joints, nothing folded.

Tensors are ``(B, T, J, C)`` throughout. It is the oracle of the tests, and the baseline of the
benchmark.
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


def linear(layer: nn.Module, x: Tensor) -> Tensor:
    """Apply a linear layer's weights with torch's own product."""
    weights = dict(layer.named_parameters())
    return nn.functional.linear(x, weights["weight"], weights.get("bias"))


def graph_convolution(layer: GraphConvolution, x: Tensor) -> Tensor:
    """Sum over the edges of each joint, for one frame (J, C)."""
    weights = layer.adjacency * layer.edge_mask + layer.edge_offset
    rows = []
    for joint in range(len(x)):
        total = layer.self_linear.weight @ x[joint] + layer.self_linear.bias
        for other in range(len(x)):
            total = total + weights[joint, other] * (layer.neighbour_linear.weight @ x[other])
        rows.append(total)
    return torch.stack(rows)


def batch_norm(layer: nn.Module, x: Tensor) -> Tensor:
    """Normalise channels by the running statistics."""
    state = layer.state_dict()
    scaled = (x - state["running_mean"]) / (state["running_var"] + 1e-5).sqrt()
    normalised: Tensor = scaled * state["weight"] + state["bias"]
    return normalised


def st_gcn(layer: StGcnLayer, x: Tensor) -> Tensor:
    """Run one example (T, J, C) through a layer in evaluation mode."""
    frames = torch.stack([graph_convolution(layer.graph_conv, frame) for frame in x]).relu()
    frames = batch_norm(layer.norms[0], frames).relu()
    kernel = layer.temporal_conv.linear.weight.view(frames.shape[-1], 5, frames.shape[-1])
    rows = []
    for centre in range(0, len(x), layer.stride):
        total = layer.temporal_conv.linear.bias.expand(frames.shape[1:])
        for shift in range(5):
            frame = centre + shift - 2
            if 0 <= frame < len(x):
                total = total + frames[frame] @ kernel[:, shift].T
        rows.append(total)
    out = batch_norm(layer.norms[1], torch.stack(rows))
    if layer.residual:
        shortcut = x[:: layer.stride]
        if isinstance(layer.shortcut, nn.Sequential):
            shortcut = batch_norm(layer.shortcut[1], layer.shortcut[0](shortcut))
        out = out + shortcut
    return out.relu() if layer.final_relu else out


class ReferenceGru(nn.Module):
    """The G-GRU by its equations: six linear layers and a message, frame by frame.

    Parameters
    ----------
    fused : whose weights it copies
    """

    def __init__(self, fused: GraphGru) -> None:
        super().__init__()
        adjacency = fused.adjacency * fused.edge_mask + fused.edge_offset
        self.register_buffer("adjacency", adjacency.detach())
        hidden = fused.hidden
        self.message = nn.Linear(hidden, hidden, bias=False)
        self.message.load_state_dict(fused.message.state_dict())
        self.gates_in = _gates(fused.gates_in, hidden)
        self.gates_hidden = _gates(fused.gates_hidden, hidden)

    def step(self, x: Tensor, state: Tensor) -> Tensor:
        """Advance one frame, (B, J, C) and (B, J, h)."""
        message = self.message(torch.einsum("ij,bjh->bih", self.adjacency, state))
        reset = torch.sigmoid(self.gates_in[0](x) + self.gates_hidden[0](message))
        update = torch.sigmoid(self.gates_in[1](x) + self.gates_hidden[1](message))
        candidate = torch.tanh(self.gates_in[2](x) + reset * self.gates_hidden[2](message))
        return update * state + (1 - update) * candidate

    def forward(self, x: Tensor, state: Tensor) -> Tensor:
        """Run over (B, T, J, C)."""
        states = []
        for frame in range(x.shape[1]):
            state = self.step(x[:, frame], state)
            states.append(state)
        return torch.stack(states, dim=1)


class ReferenceHead(nn.Module):
    """The output head, frame by frame."""

    def __init__(self, head: OutputHead) -> None:
        super().__init__()
        self.head = head

    def forward(self, x: Tensor) -> Tensor:
        """Run over (B, T, J, C)."""
        return torch.stack([self._frame(x[:, frame]) for frame in range(x.shape[1])], dim=1)

    def _frame(self, x: Tensor) -> Tensor:
        for layer in self.head.layers[:-1]:
            x = nn.functional.leaky_relu(linear(layer, x), LEAKY_SLOPE)
        return linear(self.head.layers[-1], x)


def _gates(fused: nn.Linear, hidden: int) -> nn.ModuleList:
    gates = []
    for number in range(3):
        rows = slice(number * hidden, (number + 1) * hidden)
        gate = nn.Linear(fused.in_features, hidden, bias=fused.bias is not None)
        state = {"weight": fused.weight[rows].detach()}
        if fused.bias is not None:
            state["bias"] = fused.bias[rows].detach()
        gate.load_state_dict(state)
        gates.append(gate)
    return nn.ModuleList(gates)


class ReferenceGraphConvolution(nn.Module):
    """A graph convolution by its equation, frame by frame.

    Parameters
    ----------
    layer : whose weights it uses
    """

    def __init__(self, layer: GraphConvolution) -> None:
        super().__init__()
        self.layer = layer

    def forward(self, x: Tensor) -> Tensor:
        """Run over (B, T, J, C)."""
        layer = self.layer
        adjacency = layer.adjacency * layer.edge_mask + layer.edge_offset
        frames = [
            layer.neighbour_linear(torch.einsum("ij,bjc->bic", adjacency, x[:, frame]))
            + layer.self_linear(x[:, frame])
            for frame in range(x.shape[1])
        ]
        return torch.stack(frames, dim=1)


class ReferenceTemporalConvolution(nn.Module):
    """A temporal convolution by torch's two-dimensional one, one joint wide.

    Parameters
    ----------
    layer : whose weights it copies
    """

    def __init__(self, layer: TemporalConvolution) -> None:
        super().__init__()
        weight = layer.linear.weight.detach()
        width, size = len(weight), (TEMPORAL_KERNEL, 1)
        channels = weight.shape[1] // TEMPORAL_KERNEL
        padding, stride = (TEMPORAL_KERNEL // 2, 0), (layer.stride, 1)
        self.convolution = nn.Conv2d(channels, width, size, stride=stride, padding=padding)
        kernel = weight.view(width, TEMPORAL_KERNEL, channels).transpose(1, 2)[..., None]
        state = {"weight": kernel.contiguous(), "bias": layer.linear.bias.detach()}
        self.convolution.load_state_dict(state)

    def forward(self, x: Tensor) -> Tensor:
        """Run over (B, T, J, C)."""
        out: Tensor = self.convolution(x.permute(0, 3, 1, 2)).permute(0, 2, 3, 1)
        return out


class ReferenceStGcnLayer(nn.Module):
    """An ST-GCN layer, one operation after the other.

    Parameters
    ----------
    layer : whose weights it uses
    """

    def __init__(self, layer: StGcnLayer) -> None:
        super().__init__()
        self.layer = layer
        self.graph_conv = ReferenceGraphConvolution(layer.graph_conv)
        self.temporal_conv = ReferenceTemporalConvolution(layer.temporal_conv)

    def forward(self, x: Tensor) -> Tensor:
        """Run over (B, T, J, C), without dropout."""
        first_norm, second_norm = self.layer.norms
        spatial = first_norm(self.graph_conv(x).relu()).relu()
        out: Tensor = second_norm(self.temporal_conv(spatial))
        if self.layer.residual:
            out = out + self._shortcut(x[:, :: self.layer.stride])
        return out.relu() if self.layer.final_relu else out

    def _shortcut(self, x: Tensor) -> Tensor:
        if not isinstance(self.layer.shortcut, nn.Sequential):
            return x
        layer, norm = self.layer.shortcut
        out: Tensor = norm(linear(layer, x))
        return out


def _reference_layers(layers: Iterable[nn.Module]) -> nn.ModuleList:
    return nn.ModuleList(
        [ReferenceStGcnLayer(layer) for layer in layers if isinstance(layer, StGcnLayer)]
    )


class ReferenceEncoder(nn.Module):
    """The encoder.

    Parameters
    ----------
    encoder : whose weights it uses
    """

    def __init__(self, encoder: StGcnEncoder) -> None:
        super().__init__()
        self.layers = _reference_layers(encoder.layers)

    def forward(self, x: Tensor, random: torch.Generator | None) -> Tensor:
        """Map ``(B, T, J, C)`` to ``(B, J, C')``, without dropout."""
        del random
        for layer in self.layers:
            x = layer(x)
        return x.mean(dim=1)


class ReferenceDecoder(nn.Module):
    """The decoder of the kinematic model.

    Parameters
    ----------
    decoder : whose weights it uses
    """

    def __init__(self, decoder: KinematicDecoder) -> None:
        super().__init__()
        self.decoder = decoder
        self.st_gcn = _reference_layers(decoder.st_gcn)
        self.gru, self.head = ReferenceGru(decoder.gru), ReferenceHead(decoder.head)

    def forward(self, features: Tensor, latent: Tensor) -> Tensor:
        """Map ``(B, T, J, 30)`` and ``(B, J, h)`` to ``(B, T, J, 3)``."""
        normalised = self.decoder.feature_norm(features)
        x = linear(self.decoder.joint_linear, normalised)
        x = x + linear(self.decoder.mean_linear, normalised.mean(dim=2, keepdim=True))
        for layer in self.st_gcn:
            x = layer(x)
        output: Tensor = self.head(torch.cat([self.gru(x, latent), x], dim=-1))
        return output


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
        positions = {self.root: root}
        for joint in self.skeleton.order:
            if joint != self.root:
                positions[joint] = positions[self.skeleton.parents[joint]] + bones[..., joint, :]
        return torch.stack([positions[joint] for joint in range(len(positions))], dim=-2)


def make_reference(model: SkeletonPrior) -> SkeletonPrior:
    """Replace the parts of a kinematic model by reference implementations with its weights."""
    model.kinematics = ReferenceKinematics(model.config.skeleton, model.config.limbs)
    for character in (model.first, model.second):
        if not isinstance(character, KinematicVae):
            raise TypeError(f"the model must be kinematic; got {type(character).__name__}")
        parts = {
            "kinematics": model.kinematics,
            "output_layer": model.kinematics,
            "encoder": ReferenceEncoder(character.encoder),
            "decoder": ReferenceDecoder(character.decoder),
        }
        for name, part in parts.items():
            character.add_module(name, part)
    return model
