"""Oracle: the layers' equations, as loops over frames, joints and gates."""

import pytest
import torch

from pacmo_core.data.skeleton import DUET15, EXPI18, NTU25, SBU15
from pacmo_core.skeleton_prior.kinematics import ancestor_matrix
from pacmo_core.skeleton_prior.layers import (
    GraphConvolution,
    GraphGru,
    StGcnLayer,
    ZeroInitLinear,
    initialise_weights,
    normalised_adjacency,
    off_diagonal_adjacency,
)
from pacmo_core.skeleton_prior.paper import AutoregressiveDecoder
from tests.skeleton_prior import reference
from tests.skeleton_prior.examples import generator, randomised


@pytest.mark.parametrize("skeleton", [NTU25, DUET15, SBU15, EXPI18], ids=lambda s: s.name)
def test_the_adjacency_connects_each_joint_with_itself_and_its_bones(skeleton):
    adjacency = normalised_adjacency(skeleton)
    bones = {frozenset(bone) for bone in skeleton.bones.tolist()}
    for i in range(len(adjacency)):
        for j in range(len(adjacency)):
            assert (adjacency[i, j] > 0) == (i == j or frozenset((i, j)) in bones)
    torch.testing.assert_close(adjacency.sum(dim=0), torch.ones(len(adjacency)))
    assert torch.equal(off_diagonal_adjacency(skeleton).diagonal(), torch.zeros(len(adjacency)))
    torch.testing.assert_close(
        off_diagonal_adjacency(skeleton) + torch.diag(adjacency.diagonal()), adjacency
    )


@pytest.mark.parametrize("skeleton", [NTU25, EXPI18], ids=lambda s: s.name)
def test_the_ancestor_matrix_sums_bones_into_joint_positions(skeleton):
    motion = torch.randn(4, len(skeleton.joints), 3, generator=generator(), dtype=torch.float64)
    bones = motion.clone()
    for parent, child in skeleton.bones.tolist():
        bones[:, child] = motion[:, child] - motion[:, parent]
    torch.testing.assert_close(ancestor_matrix(skeleton).double() @ bones, motion)


@pytest.mark.parametrize(("into", "out"), [(3, 7), (7, 3), (4, 4)])
def test_a_graph_convolution_is_the_sum_over_edges(into, out):
    layer = randomised(GraphConvolution(off_diagonal_adjacency(SBU15), into, out))
    x = torch.randn(2, into, 5, 15, generator=generator())
    expected = [
        torch.stack([reference.graph_convolution(layer, frame) for frame in row])
        for row in x.permute(0, 2, 3, 1)
    ]
    torch.testing.assert_close(layer(x).permute(0, 2, 3, 1), torch.stack(expected))


@pytest.mark.parametrize("stride", [1, 2])
@pytest.mark.parametrize("n_frames", [1, 8, 9])
@pytest.mark.parametrize(("into", "out", "residual"), [(3, 6, False), (6, 6, True), (4, 6, True)])
def test_an_st_gcn_layer_equals_its_loops(stride, n_frames, into, out, residual):
    adjacency = off_diagonal_adjacency(SBU15)
    layer = randomised(StGcnLayer(adjacency, (into, out), stride=stride, residual=residual))
    x = torch.randn(2, into, n_frames, 15, generator=generator())
    result = layer(x).permute(0, 2, 3, 1)
    assert result.shape == (2, -(-n_frames // stride), 15, out)
    expected = torch.stack([reference.st_gcn(layer, row) for row in x.permute(0, 2, 3, 1)])
    torch.testing.assert_close(result, expected, atol=1e-5, rtol=1e-5)


def run(layer: GraphGru, x: torch.Tensor, state: torch.Tensor) -> torch.Tensor:
    """Run over a sequence (B, T, J, C) from a state (B, J, h), to (B, T, J, h)."""
    states = [state]
    for frame in x.unbind(dim=1):
        states.append(layer(frame, states[-1], layer.adjacency()))
    return torch.stack(states[1:], dim=1)


def test_the_graph_gru_is_its_corrected_equation():
    layer = randomised(GraphGru(normalised_adjacency(SBU15), 5, 8))
    x = torch.randn(3, 7, 15, 5, generator=generator())
    state = torch.randn(3, 15, 8, generator=generator(1))
    expected = [reference.graph_gru(layer, row, own) for row, own in zip(x, state, strict=True)]
    torch.testing.assert_close(run(layer, x, state), torch.stack(expected))


def test_the_graph_grus_state_is_bounded_by_one():
    layer = randomised(GraphGru(normalised_adjacency(SBU15), 5, 8))
    x = 100 * torch.randn(2, 50, 15, 5, generator=generator())
    states = run(layer, x, torch.zeros(2, 15, 8))
    assert states.abs().max() <= 1  # with sums outside the sigmoid they leave these bounds


def test_the_graph_gru_is_causal():
    layer = randomised(GraphGru(normalised_adjacency(SBU15), 5, 8))
    x = torch.randn(2, 9, 15, 5, generator=generator())
    other = x.clone()
    other[:, 6:] = 0
    state = torch.zeros(2, 15, 8)
    assert torch.equal(run(layer, x, state)[:, :6], run(layer, other, state)[:, :6])


def test_an_output_head_is_linear_layers_with_leaky_relus():
    head = randomised(AutoregressiveDecoder(SBU15, 1, 6)).head
    x = torch.randn(2, 4, 15, 6, generator=generator())
    a, b, c = (layer for layer in head if isinstance(layer, torch.nn.Linear))
    leak = torch.nn.LeakyReLU(0.1)
    torch.testing.assert_close(head(x), c(leak(b(leak(a(x))))))


def test_weights_are_within_the_inverse_root_of_the_fan_in_or_zero():
    layers = torch.nn.Sequential(
        torch.nn.Conv2d(4, 5, (3, 1)), torch.nn.Linear(16, 2), ZeroInitLinear(4, 3)
    )
    initialise_weights(layers, generator())
    for layer, bound in zip(layers, (12**-0.5, 0.25, 0), strict=True):
        largest = max(weight.abs().max() for weight in layer.parameters())
        assert 0.7 * bound <= largest <= bound
    weights = layers[0].weight.clone()
    initialise_weights(layers, generator())
    assert torch.equal(layers[0].weight, weights)


def test_a_layer_of_an_unknown_class_is_refused():
    with pytest.raises(TypeError, match="no initialisation for layers of class Bilinear"):
        initialise_weights(torch.nn.Bilinear(2, 2, 2), generator())
