"""Reference implementation of the layers: loops over frames, joints and gates. Oracle of tests."""

import torch
from torch import Tensor, nn

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.skeleton_prior.kinematics import KinematicOutput, Limb
from pacmo_core.skeleton_prior.layers import GraphConvolution, GraphGru, LearntAdjacency, StGcnLayer


def learnt(layer: LearntAdjacency) -> Tensor:
    """Compute the weights of all edges (J, J)."""
    return layer.adjacency * layer.edge_mask + layer.edge_offset


def graph_convolution(layer: GraphConvolution, x: Tensor) -> Tensor:
    """Sum over the edges of each joint, for one frame (J, C)."""
    weights = learnt(layer.adjacency)
    neighbour, own = layer.linear.weight[:, :, 0, 0].chunk(2, dim=1)
    rows = []
    for joint in range(len(x)):
        total = own @ x[joint] + layer.linear.bias
        for other in range(len(x)):
            total = total + weights[joint, other] * (neighbour @ x[other])
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
    graph, _, norm, _ = layer.spatial
    convolution, last_norm = layer.temporal
    frames = torch.stack([graph_convolution(graph, frame) for frame in x]).relu()
    frames = batch_norm(norm, frames).relu()
    stride, kernel = convolution.stride[0], convolution.weight[..., 0]
    rows = []
    for centre in range(0, len(x), stride):
        total = convolution.bias.expand(frames.shape[1:])
        for shift in range(5):
            frame = centre + shift - 2
            if 0 <= frame < len(x):
                total = total + frames[frame] @ kernel[..., shift].T
        rows.append(total)
    out = batch_norm(last_norm, torch.stack(rows))
    if layer.residual:
        shortcut = x[::stride]
        if isinstance(layer.shortcut, nn.Sequential):
            linear, norm = layer.shortcut
            shortcut = batch_norm(norm, shortcut @ linear.weight[:, :, 0, 0].T + linear.bias)
        out = out + shortcut
    return out.relu() if layer.final_relu else out


def graph_gru(layer: GraphGru, x: Tensor, state: Tensor) -> Tensor:
    """Run one example (T, J, C) from a state (J, h), gate by gate."""
    weights = learnt(layer.adjacency)
    into = list(zip(layer.gates_in.weight.chunk(3), layer.gates_in.bias.chunk(3), strict=True))
    hidden = layer.gates_hidden.weight.chunk(3)
    states = []
    for frame in x:
        message = weights @ state @ layer.message.weight.T
        reset, update, candidate = (frame @ w.T + b for w, b in into)
        reset = torch.sigmoid(reset + message @ hidden[0].T)
        update = torch.sigmoid(update + message @ hidden[1].T)
        candidate = torch.tanh(candidate + reset * (message @ hidden[2].T))
        state = update * state + (1 - update) * candidate
        states.append(state)
    return torch.stack(states)


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
