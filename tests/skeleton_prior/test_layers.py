"""Oracle: the layers' equations, as loops over frames, joints and gates."""

import copy

import pytest
import torch

from pacmo_core.data.skeleton import DUET15, EXPI18, NTU25, SBU15
from pacmo_core.skeleton_prior import training
from pacmo_core.skeleton_prior.data import encode_examples
from pacmo_core.skeleton_prior.kinematics import ancestor_matrix
from pacmo_core.skeleton_prior.layers import (
    GraphConvolution,
    GraphGru,
    OutputHead,
    StGcnLayer,
    TemporalConvolution,
    batch_first,
    dropout,
    frames_first,
    initialise_weights,
    normalised_adjacency,
    off_diagonal_adjacency,
)
from tests.skeleton_prior import reference
from tests.skeleton_prior.examples import examples, generator, randomised, settings


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
    x = torch.randn(2, 5, 15, into, generator=generator())
    expected = torch.stack(
        [torch.stack([reference.graph_convolution(layer, frame) for frame in row]) for row in x]
    )
    torch.testing.assert_close(batch_first(layer(frames_first(x))), expected)
    torch.testing.assert_close(reference.ReferenceGraphConvolution(layer)(x), expected)


@pytest.mark.parametrize("stride", [1, 2])
@pytest.mark.parametrize("n_frames", [1, 8, 9])
@pytest.mark.parametrize(("into", "out", "residual"), [(3, 6, False), (6, 6, True), (4, 6, True)])
def test_an_st_gcn_layer_equals_its_loops(stride, n_frames, into, out, residual):
    adjacency = off_diagonal_adjacency(SBU15)
    layer = randomised(
        StGcnLayer(adjacency, into, out, stride=stride, dropout=0.5, residual=residual)
    )
    x = torch.randn(2, n_frames, 15, into, generator=generator())
    result = batch_first(layer(frames_first(x), None))
    assert result.shape == (2, -(-n_frames // stride), 15, out)
    torch.testing.assert_close(
        result, torch.stack([reference.st_gcn(layer, row) for row in x]), atol=1e-5, rtol=1e-5
    )


def test_an_st_gcn_layers_gradient_equals_finite_differences():
    layer = StGcnLayer(
        off_diagonal_adjacency(NTU25), 3, 5, stride=2, dropout=0.0, residual=True
    ).double()
    initialise_weights(layer, generator())
    x = torch.randn(5, 25, 2, 3, generator=generator(), dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda v: layer(v, None)[:, :3], x, atol=1e-4, eps=1e-6)


def gradients_equal_differences(layer, *inputs):
    """Compare gradients of inputs and of all weights with finite differences, in float64."""
    weights = dict(layer.named_parameters())

    def run(*given):
        own = dict(zip(weights, given[len(inputs) :], strict=True))
        return torch.func.functional_call(layer, own, given[: len(inputs)])

    drawn = [torch.randn(shape, generator=generator(7), dtype=torch.float64) for shape in inputs]
    given = [value.detach().requires_grad_() for value in [*drawn, *weights.values()]]
    return torch.autograd.gradcheck(run, tuple(given), atol=1e-6, eps=1e-6)


@pytest.mark.parametrize(("into", "out"), [(2, 4), (4, 2)])
def test_a_graph_convolutions_gradients_equal_finite_differences(into, out):
    layer = randomised(GraphConvolution(off_diagonal_adjacency(SBU15), into, out).double())
    assert gradients_equal_differences(layer, (2, 15, 1, into))


@pytest.mark.parametrize(("n_frames", "stride"), [(1, 1), (4, 1), (7, 1), (7, 2)])
def test_a_temporal_convolutions_gradients_equal_finite_differences(n_frames, stride):
    layer = randomised(TemporalConvolution(2, 3, stride=stride).double())
    assert gradients_equal_differences(layer, (n_frames, 3, 2, 2))


@pytest.mark.parametrize(("n_frames", "stride"), [(1, 1), (4, 1), (7, 1), (7, 2), (8, 2)])
def test_a_temporal_convolution_equals_torchs(n_frames, stride):
    layer = randomised(TemporalConvolution(4, 6, stride=stride))
    x = torch.randn(3, n_frames, 5, 4, generator=generator())
    result = batch_first(layer(frames_first(x)))
    torch.testing.assert_close(
        result, reference.ReferenceTemporalConvolution(layer)(x), atol=1e-5, rtol=1e-5
    )


def test_a_heads_gradients_equal_finite_differences():
    assert gradients_equal_differences(randomised(OutputHead(4, 3).double()), (2, 3, 4))


def test_the_graph_grus_gradients_equal_finite_differences():
    layer = randomised(GraphGru(normalised_adjacency(SBU15), 2, 3).double())
    assert gradients_equal_differences(layer, (3, 15, 2, 2), (15, 2, 3))


def test_the_graph_grus_gradient_does_not_depend_on_the_memory_layout():
    layer = randomised(GraphGru(normalised_adjacency(SBU15), 2, 3))
    state = torch.zeros(15, 4, 3)
    rows = torch.randn(4, 6, 15, 2, generator=generator())
    result = []
    for layout in (rows.permute(1, 2, 0, 3), frames_first(rows)):
        x = layout.detach().requires_grad_()
        layer(x, state).square().sum().backward()
        result.append(x.grad)
    assert result[1].abs().max() > 0
    torch.testing.assert_close(*result)


def test_the_graph_gru_is_its_corrected_equation():
    fused = randomised(GraphGru(normalised_adjacency(SBU15), 5, 8))
    x = torch.randn(3, 7, 15, 5, generator=generator())
    state = torch.randn(3, 15, 8, generator=generator(1))
    expected = reference.ReferenceGru(fused)(x, state)
    given = frames_first(x), state.transpose(0, 1).contiguous()
    torch.testing.assert_close(batch_first(fused(*given)), expected)
    with torch.no_grad():  # without gradients
        torch.testing.assert_close(batch_first(fused(*given)), expected)


def test_the_graph_grus_state_is_bounded_by_one():
    fused = randomised(GraphGru(normalised_adjacency(SBU15), 5, 8))
    x = 100 * torch.randn(50, 15, 2, 5, generator=generator())
    states = fused(x, torch.zeros(15, 2, 8))
    assert states.abs().max() <= 1  # with sums outside the sigmoid they leave these bounds


def test_the_graph_gru_is_causal():
    fused = randomised(GraphGru(normalised_adjacency(SBU15), 5, 8))
    x = torch.randn(9, 15, 2, 5, generator=generator())
    other = x.clone()
    other[6:] = 0
    state = torch.zeros(15, 2, 8)
    assert torch.equal(fused(x, state)[:6], fused(other, state)[:6])


def test_an_output_head_is_linear_layers_with_leaky_relus():
    head = randomised(OutputHead(6, 3))
    x = torch.randn(2, 4, 15, 6, generator=generator())
    a, b, c = head.layers
    leak = torch.nn.LeakyReLU(0.1)
    torch.testing.assert_close(head(x), c(leak(b(leak(a(x))))))
    torch.testing.assert_close(reference.ReferenceHead(head)(x), head(x))


def test_dropout_preserves_the_mean_and_uses_the_generator_only():
    x = torch.ones(100_000)
    dropped = dropout(x, 0.25, generator())
    assert torch.equal(dropped, dropout(x, 0.25, generator()))
    assert abs(float(dropped.mean()) - 1) < 0.01
    assert abs(float((dropped == 0).float().mean()) - 0.25) < 0.01
    assert dropout(x, 0.25, None) is x


def test_a_layer_of_an_unknown_class_is_refused():
    with pytest.raises(ValueError, match="no initialisation for layers of class Bilinear"):
        initialise_weights(torch.nn.Bilinear(2, 2, 2), generator())


def test_the_kinematic_model_equals_its_reference_implementation():
    model = training.build_training(examples(), settings(n_epochs=1, dropout=0.0)).finish()
    (batch, *_) = encode_examples(examples()).full_length_batches(model.config.frame_stride, 4)
    given = [each.double() for each in (batch.template, batch.scales, batch.variation)]

    def motions_and_gradient(of):
        motions = of.train().requires_grad_().reconstruct(*given, generator()).motions
        (motions - given[-1]).square().mean().backward()
        return motions.detach(), of.first.posterior.mean.weight.grad

    result, gradient = motions_and_gradient(copy.deepcopy(model).double())
    expected, reference_gradient = motions_and_gradient(
        reference.make_reference(copy.deepcopy(model)).double()
    )
    assert gradient.abs().max() > 0
    torch.testing.assert_close(result, expected)
    torch.testing.assert_close(gradient, reference_gradient)
