"""What is trusted: the layers' equations, as plain loops over frames, joints and gates."""

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
from tests.skeleton_prior.examples import examples, generator, settings, shaken


@pytest.mark.parametrize("skeleton", [NTU25, DUET15, SBU15, EXPI18], ids=lambda s: s.name)
def test_the_adjacency_links_each_joint_with_itself_and_its_bones(skeleton):
    links = normalised_adjacency(skeleton)
    bones = {frozenset(bone) for bone in skeleton.bones.tolist()}
    for i in range(len(links)):
        for j in range(len(links)):
            assert (links[i, j] > 0) == (i == j or frozenset((i, j)) in bones)
    torch.testing.assert_close(links.sum(dim=0), torch.ones(len(links)))
    assert torch.equal(off_diagonal_adjacency(skeleton).diagonal(), torch.zeros(len(links)))
    torch.testing.assert_close(
        off_diagonal_adjacency(skeleton) + torch.diag(links.diagonal()), links
    )


@pytest.mark.parametrize("skeleton", [NTU25, EXPI18], ids=lambda s: s.name)
def test_paths_sum_bones_into_places(skeleton):
    motion = torch.randn(4, len(skeleton.joints), 3, generator=generator(), dtype=torch.float64)
    bones = motion.clone()
    for parent, child in skeleton.bones.tolist():
        bones[:, child] = motion[:, child] - motion[:, parent]
    torch.testing.assert_close(ancestor_matrix(skeleton).double() @ bones, motion)


@pytest.mark.parametrize(("into", "out"), [(3, 7), (7, 3), (4, 4)])
def test_a_graph_convolution_is_the_sum_over_links(into, out):
    layer = shaken(GraphConvolution(off_diagonal_adjacency(SBU15), into, out))
    x = torch.randn(2, 5, 15, into, generator=generator())
    wanted = torch.stack(
        [torch.stack([reference.graph_convolution(layer, frame) for frame in row]) for row in x]
    )
    torch.testing.assert_close(batch_first(layer(frames_first(x))), wanted)
    torch.testing.assert_close(reference.ReferenceConvolution(layer)(x), wanted)


@pytest.mark.parametrize("stride", [1, 2])
@pytest.mark.parametrize("n_frames", [1, 8, 9])
@pytest.mark.parametrize(("into", "out", "residual"), [(3, 6, False), (6, 6, True), (4, 6, True)])
def test_an_st_gcn_layer_is_what_the_loops_say(stride, n_frames, into, out, residual):
    links = off_diagonal_adjacency(SBU15)
    layer = shaken(StGcnLayer(links, into, out, stride=stride, dropout=0.5, residual=residual))
    x = torch.randn(2, n_frames, 15, into, generator=generator())
    got = batch_first(layer(frames_first(x), None))
    assert got.shape == (2, -(-n_frames // stride), 15, out)
    torch.testing.assert_close(
        got, torch.stack([reference.st_gcn(layer, row) for row in x]), atol=1e-5, rtol=1e-5
    )


def test_an_st_gcn_layer_trains_on_every_shape_its_gradient_is_the_slope():
    layer = StGcnLayer(
        off_diagonal_adjacency(NTU25), 3, 5, stride=2, dropout=0.0, residual=True
    ).double()
    initialise_weights(layer, generator())
    x = torch.randn(5, 25, 2, 3, generator=generator(), dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda v: layer(v, None)[:, :3], x, atol=1e-4, eps=1e-6)


def slopes_hold(layer, *inputs):
    """Hold the gradients of inputs and of all weights against differences, in float64."""
    weights = dict(layer.named_parameters())

    def run(*given):
        own = dict(zip(weights, given[len(inputs) :], strict=True))
        return torch.func.functional_call(layer, own, given[: len(inputs)])

    drawn = [torch.randn(shape, generator=generator(7), dtype=torch.float64) for shape in inputs]
    given = [value.detach().requires_grad_() for value in [*drawn, *weights.values()]]
    return torch.autograd.gradcheck(run, tuple(given), atol=1e-6, eps=1e-6)


@pytest.mark.parametrize(("into", "out"), [(2, 4), (4, 2)])
def test_a_graph_convolutions_gradients_are_its_slopes(into, out):
    layer = shaken(GraphConvolution(off_diagonal_adjacency(SBU15), into, out).double())
    assert slopes_hold(layer, (2, 15, 1, into))


@pytest.mark.parametrize(("n_frames", "stride"), [(1, 1), (4, 1), (7, 1), (7, 2)])
def test_a_time_convolutions_gradients_are_its_slopes(n_frames, stride):
    layer = shaken(TemporalConvolution(2, 3, stride=stride).double())
    assert slopes_hold(layer, (n_frames, 3, 2, 2))


@pytest.mark.parametrize(("n_frames", "stride"), [(1, 1), (4, 1), (7, 1), (7, 2), (8, 2)])
def test_a_time_convolution_is_the_plain_one(n_frames, stride):
    layer = shaken(TemporalConvolution(4, 6, stride=stride))
    x = torch.randn(3, n_frames, 5, 4, generator=generator())
    got = batch_first(layer(frames_first(x)))
    torch.testing.assert_close(got, reference.ReferenceTime(layer)(x), atol=1e-5, rtol=1e-5)


def test_a_heads_gradients_are_its_slopes():
    assert slopes_hold(shaken(OutputHead(4, 3).double()), (2, 3, 4))


def test_the_graph_grus_gradients_are_its_slopes():
    layer = shaken(GraphGru(normalised_adjacency(SBU15), 2, 3).double())
    assert slopes_hold(layer, (3, 15, 2, 2), (15, 2, 3))


def test_the_graph_gru_gives_its_gradient_to_an_input_laid_out_otherwise():
    layer = shaken(GraphGru(normalised_adjacency(SBU15), 2, 3))
    state = torch.zeros(15, 4, 3)
    rows = torch.randn(4, 6, 15, 2, generator=generator())
    found = []
    for laid_out in (rows.permute(1, 2, 0, 3), frames_first(rows)):
        x = laid_out.detach().requires_grad_()
        layer(x, state).square().sum().backward()
        found.append(x.grad)
    assert found[1].abs().max() > 0
    torch.testing.assert_close(*found)


def test_the_graph_gru_is_its_corrected_equation():
    fused = shaken(GraphGru(normalised_adjacency(SBU15), 5, 8))
    x = torch.randn(3, 7, 15, 5, generator=generator())
    state = torch.randn(3, 15, 8, generator=generator(1))
    wanted = reference.ReferenceGru(fused)(x, state)
    given = frames_first(x), state.transpose(0, 1).contiguous()
    torch.testing.assert_close(batch_first(fused(*given)), wanted)
    with torch.no_grad():  # where nothing is kept for gradients
        torch.testing.assert_close(batch_first(fused(*given)), wanted)


def test_the_graph_grus_gates_keep_its_state_between_what_it_was_and_one():
    fused = shaken(GraphGru(normalised_adjacency(SBU15), 5, 8))
    x = 100 * torch.randn(50, 15, 2, 5, generator=generator())
    states = fused(x, torch.zeros(15, 2, 8))
    assert states.abs().max() <= 1  # with sums outside the sigmoid they leave these bounds


def test_the_graph_gru_looks_at_no_later_frame():
    fused = shaken(GraphGru(normalised_adjacency(SBU15), 5, 8))
    x = torch.randn(9, 15, 2, 5, generator=generator())
    other = x.clone()
    other[6:] = 0
    state = torch.zeros(15, 2, 8)
    assert torch.equal(fused(x, state)[:6], fused(other, state)[:6])


def test_a_head_is_dense_layers_with_leaky_relus():
    head = shaken(OutputHead(6, 3))
    x = torch.randn(2, 4, 15, 6, generator=generator())
    a, b, c = head.layers
    leak = torch.nn.LeakyReLU(0.1)
    torch.testing.assert_close(head(x), c(leak(b(leak(a(x))))))
    torch.testing.assert_close(reference.ReferenceHead(head)(x), head(x))


def test_dropping_keeps_the_mean_and_draws_from_the_generator_alone():
    x = torch.ones(100_000)
    dropped = dropout(x, 0.25, generator())
    assert torch.equal(dropped, dropout(x, 0.25, generator()))
    assert abs(float(dropped.mean()) - 1) < 0.01
    assert abs(float((dropped == 0).float().mean()) - 0.25) < 0.01
    assert dropout(x, 0.25, None) is x


def test_a_layer_of_an_unknown_kind_has_no_law():
    with pytest.raises(ValueError, match="no initialisation for layers of class Bilinear"):
        initialise_weights(torch.nn.Bilinear(2, 2, 2), generator())


def test_our_form_is_the_same_network_written_plainly():
    model = training.build_training(examples(), settings(n_epochs=1, dropout=0.0)).finish()
    (pairs, *_) = encode_examples(examples()).full_length_batches(model.config.frame_stride, 4)
    given = [each.double() for each in (pairs.template, pairs.scales, pairs.variation)]

    def motions_and_slope(of):
        motions = of.train().requires_grad_().reconstruct(*given, generator()).motions
        (motions - given[-1]).square().mean().backward()
        return motions.detach(), of.first.posterior.mean.weight.grad

    got, slope = motions_and_slope(copy.deepcopy(model).double())
    wanted, plain_slope = motions_and_slope(reference.make_reference(copy.deepcopy(model)).double())
    assert slope.abs().max() > 0
    torch.testing.assert_close(got, wanted)
    torch.testing.assert_close(slope, plain_slope)
