"""Oracle: the layer sizes and parameter counts of tables 11 to 20 of the supplement."""

from itertools import pairwise

import pytest
import torch

from pacmo_core.data.skeleton import NTU25
from pacmo_core.models import build_skeleton_prior, model_names
from pacmo_core.skeleton_prior.layers import ZeroInitLinear, initialise_weights
from pacmo_core.skeleton_prior.settings import PriorConfig
from tests.skeleton_prior.examples import START, generator

B, T, N = 2, 37, 25
HALVES = [T, 19, 10, 5, 5]  # T, T/2, T/4, T/8, T/8, rounded up
LIMBS = ((12, 13, 14), (16, 17, 18), (4, 5, 6), (8, 9, 10))


def model(name: str, hidden: int = 256):
    return build_skeleton_prior(PriorConfig(NTU25, LIMBS, name, hidden, 1, 30.0, START)).eval()


def character_inputs(prior, role: int):
    random = generator()
    template = torch.randn(B, T, 2, N, 3, generator=random)
    scales = torch.ones(B, 2, N)
    if role == 0:
        return prior.first_condition(template, scales)
    return prior.second_condition(template, scales, template[:, :, 0])


def shapes(modules, run):
    """Record the output shapes of modules during a call."""
    output_shapes = []
    hooks = [
        m.register_forward_hook(lambda _m, _i, out: output_shapes.append(tuple(out.shape)))
        for m in modules
    ]
    with torch.no_grad():
        result = run()
    for hook in hooks:
        hook.remove()
    return output_shapes, result


def graph(into: int, out: int) -> int:
    return 2 * into * out + out + 2 * N * N  # W, U with bias, edge mask and offset


def st_gcn(into: int, out: int, stride: int, residual: bool) -> int:
    """Parameters of graph convolution, norms, temporal convolution and shortcut."""
    count = graph(into, out) + 4 * out + 5 * out * out + out
    return count + (into * out + 3 * out if residual and (into != out or stride > 1) else 0)


def linear(into: int, out: int) -> int:
    return into * out + out


def encoder(channels: list[int]) -> int:
    strides = [1, 2, 2, 2, 1]
    rows = zip(channels, channels[1:], strides, strict=False)
    return sum(st_gcn(a, b, s, number > 0) for number, (a, b, s) in enumerate(rows))


def g_gru(into: int) -> int:
    """Parameters of input gates, message, hidden gates, and the adjacency's mask and offset."""
    return 3 * linear(into, 256) + 256 * 256 + 3 * 256 * 256 + 2 * N * N


HEAD = linear(256, 256) + linear(256, 256) + linear(256, 3)


def size(module) -> int:
    return sum(weight.numel() for weight in module.parameters())


@pytest.mark.parametrize(("role", "into", "table"), [(0, 4, 11), (1, 3, 13)])
def test_st_gcn_1_and_2_are_tables_11_and_13(role, into, table):
    prior = model("paper")
    character = (prior.first, prior.second)[role]
    inputs = character_inputs(prior, role)
    output_shapes, posterior = shapes(
        character.encoder.layers, lambda: character.encode(inputs.template, inputs)
    )
    channels = [32, 64, 128, 256, 256]
    assert output_shapes == [(B, c, t, N) for t, c in zip(HALVES, channels, strict=True)]
    assert posterior.mean.shape == posterior.log_variance.shape == (B, N, 256)
    assert size(character.encoder) == encoder([into, *channels])


def test_table_11_ends_in_262_channels_and_a_dense_layer():
    prior = model("paper")
    assert size(prior.first.posterior) == 2 * linear(262, 256)  # two heads where the table has one


def test_st_gcn_3_is_table_14_and_the_fusion_table_15():
    prior = model("paper")
    inputs = character_inputs(prior, 1)
    output_shapes, _ = shapes(
        prior.second.partner_encoder.layers,
        lambda: prior.second.encode(inputs.template, inputs),
    )
    assert output_shapes == [(B, 16, t, N) for t in HALVES]
    assert size(prior.second.partner_encoder) == encoder([8, 16, 16, 16, 16, 16])
    assert size(prior.second.fusion) == linear(278, 256)
    assert size(prior.second.posterior) == 2 * linear(256, 256)


@pytest.mark.parametrize(("role", "into", "table"), [(0, 10, 12), (1, 25, 16)])
def test_the_g_grus_are_tables_12_and_16(role, into, table):
    prior = model("paper")
    character = (prior.first, prior.second)[role]
    inputs = character_inputs(prior, role)
    assert character.latent_shape(inputs.template) == (B, N, 256)
    layers = [layer for layer in character.decoder.head if isinstance(layer, torch.nn.Linear)]
    output_shapes, output = shapes(layers, lambda: character.decode(torch.zeros(B, N, 256), inputs))
    assert len(output_shapes) == 3 * T  # frame by frame
    assert [shape[-1] for shape in output_shapes[:3]] == [256, 256, 3]
    assert output.shape == (B, T, N, 3)
    assert size(character.decoder) == g_gru(into) + HEAD


def test_the_paper_model_has_the_parameters_of_its_tables():
    prior = model("paper")
    expected = (
        encoder([4, 32, 64, 128, 256, 256]) + 2 * linear(262, 256) + g_gru(10) + HEAD
        + encoder([3, 32, 64, 128, 256, 256]) + encoder([8, 16, 16, 16, 16, 16])
        + linear(278, 256) + 2 * linear(256, 256) + g_gru(25) + HEAD
    )  # fmt: skip
    assert size(prior.first) + size(prior.second) == expected


def conv(into: int, out: int, kernel: int = 3) -> int:
    return linear(kernel * into, out)


def convs_1d(*channels: int) -> int:
    return sum(conv(a, b) for a, b in pairwise(channels))


def graphs(*channels: int) -> int:
    return sum(graph(a, b) for a, b in pairwise(channels))


def conv_2d(*channels: int) -> int:
    return sum(conv(a, b, 9) for a, b in pairwise(channels))


def stack(first: bool, *channels: int) -> int:
    rows = enumerate(pairwise(channels))
    return sum(st_gcn(a, b, 1, not (first and number == 0)) for number, (a, b) in rows)


N_PARAMETERS = {
    ("f_cnn", 0): convs_1d(3, 32, 64, 128, 256) + 2 * linear(260, 256) + linear(260, 256)
    + convs_1d(256, 256, 128, 32) + linear(32, 3),
    ("f_cnn", 1): convs_1d(3, 32, 64, 128, 256) + 2 * linear(264, 256) + linear(264, 256)
    + convs_1d(256, 128, 64, 32) + linear(32, 3),
    ("f_gcn", 0): graphs(3, 32, 64) + linear(4, 20) + graph(84, 128) + graph(128, 512)
    + graphs(276, 256, 128, 64, 32, 3) + linear(3, 3),
    ("f_gcn", 1): graphs(3, 32, 64) + linear(6, 16) + graph(80, 128) + graph(128, 512)
    + graphs(272, 256, 128, 64, 32, 3) + linear(3, 3),
    ("m_cnn", 0): conv_2d(4, 16, 32) + 2 * conv_2d(32, 64) + linear(65, 64) + conv_2d(64, 32, 16, 3)
    + linear(3, 3),
    ("m_cnn", 1): linear(3, 8) + conv_2d(16, 32) + 2 * conv_2d(32, 64) + linear(72, 64)
    + conv_2d(64, 32, 16) + linear(16, 3),
    ("m_gcn", 0): stack(True, 4, 32, 64, 128) + 2 * linear(128, 128)
    + stack(False, 129, 128, 64, 32, 16, 3),
    ("m_gcn", 1): stack(True, 3, 32, 64, 128) + linear(6, 16) + 2 * linear(144, 128)
    + stack(False, 144, 128, 64, 32) + linear(32, 3),
}  # fmt: skip


@pytest.mark.parametrize(("name", "role"), N_PARAMETERS)
def test_the_baselines_are_tables_17_to_20(name, role):
    prior = model(name)
    assert size((prior.first, prior.second)[role]) == N_PARAMETERS[name, role]


LATENT_SHAPES = {
    "f_cnn": (B, 256, T, 4),
    "f_gcn": (B, 256, T, N),
    "m_cnn": (B, 64, T, N),
    "m_gcn": (B, 128, T, N),
}


@pytest.mark.parametrize("role", [0, 1])
@pytest.mark.parametrize("name", LATENT_SHAPES)
def test_the_baselines_latents_have_the_tables_shapes(name, role):
    prior = model(name)
    character, inputs = (prior.first, prior.second)[role], character_inputs(prior, role)
    with torch.no_grad():
        posterior = character.encode(inputs.template, inputs)
        output = character.decode(torch.zeros(LATENT_SHAPES[name]), inputs)
    assert (
        posterior.mean.shape
        == posterior.log_variance.shape
        == character.latent_shape(inputs.template)
        == LATENT_SHAPES[name]
    )
    assert output.shape == (B, T, N, 3)


def test_f_cnn_pools_joints_as_in_its_table_and_inverts_it():
    prior = model("f_cnn")
    inputs = character_inputs(prior, 0)
    convolutions = [m for m in prior.first.decoder if isinstance(m, torch.nn.ConvTranspose2d)]
    output_shapes, _ = shapes(
        convolutions, lambda: prior.first.decode(torch.zeros(B, 256, T, 4), inputs)
    )
    assert output_shapes == [(B, 256, T, 7), (B, 128, T, 13), (B, 32, T, 25)]
    with torch.no_grad():
        pooled = prior.first.condition(prior.first.features(inputs))
    joints = prior.first.features(inputs)[0, :, 0]
    torch.testing.assert_close(pooled[0, :, 0, 0], joints[:, :8].mean(dim=1))
    torch.testing.assert_close(pooled[0, :, 0, 3], joints[:, 24])  # the last joint alone


@pytest.mark.parametrize("name", model_names("skeleton_prior"))
def test_every_weight_of_every_model_has_a_gradient(name):
    # Wide enough that no layer is dead by chance: of four channels behind a ReLU, one time in ten.
    prior, random = model(name).train(), generator()
    initialise_weights(prior, random)
    for layer in prior.modules():
        if isinstance(layer, ZeroInitLinear):  # before training, layers below it have no gradient
            torch.nn.init.normal_(layer.weight, generator=random)
    template = torch.randn(B, 9, 2, N, 3, generator=random)
    scales = 1 + 0.1 * torch.rand(B, 2, N, generator=random)
    varied = template + 0.1 * torch.randn(template.shape, generator=random)
    motions, posteriors = prior.reconstruct(
        template, scales, varied, torch.tensor([True, False]), random
    )
    loss = motions.square().mean() + sum(posterior.kl_divergence() for posterior in posteriors)
    loss.backward()
    trained = [(n, w) for n, w in prior.named_parameters() if not n.startswith("skeleton_vae")]
    flat = [name for name, weight in trained if weight.grad is None or not weight.grad.any()]
    assert flat == []


def test_an_unknown_model_is_refused_by_name():
    with pytest.raises(ValueError, match="model must be one of kinematic, .*paper, f_cnn.*'mlp'"):
        build_skeleton_prior(PriorConfig(NTU25, LIMBS, "mlp", 32, 1, 30.0, START))


def test_displacements_are_added_to_the_template():
    template, output = torch.randn(2, B, T, N, 3, generator=generator())
    positions = model("paper", 16).first.joint_positions(output, template, torch.ones(B, N))
    assert torch.equal(positions, template + output)
