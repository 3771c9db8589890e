"""What is trusted: tables 11 to 20 of the supplement, row by row, and sums made of their rows."""

from itertools import pairwise

import pytest
import torch

from pacmo_core.data.skeleton import NTU25
from pacmo_core.models import build_skeleton_prior, model_names
from pacmo_core.skeleton_prior.layers import ZeroInitLinear, initialise_weights
from pacmo_core.skeleton_prior.settings import PriorConfig
from tests.skeleton_prior.examples import generator

B, T, N = 2, 37, 25
HALVES = [T, 19, 10, 5, 5]  # T, T/2, T/4, T/8, T/8, rounded up
LIMBS = ((12, 13, 14), (16, 17, 18), (4, 5, 6), (8, 9, 10))


def model(name: str, hidden: int = 256):
    return build_skeleton_prior(PriorConfig(NTU25, LIMBS, name, hidden, 1, 30.0, 0.0)).eval()


def given(form, role: int):
    random = generator()
    template = torch.randn(B, T, 2, N, 3, generator=random)
    scales = torch.ones(B, 2, N)
    if role == 0:
        return form.first_inputs(template, scales)
    return form.second_inputs(template, scales, template[:, :, 0])


def shapes(modules, run):
    """Record what goes out of some modules while something runs."""
    found = []
    hooks = [
        m.register_forward_hook(lambda _m, _i, out: found.append(tuple(out.shape))) for m in modules
    ]
    with torch.no_grad():
        result = run()
    for hook in hooks:
        hook.remove()
    return found, result


def graph(into: int, out: int) -> int:
    return 2 * into * out + out + 2 * N * N  # W, U with bias, mask and added links


def st_gcn(into: int, out: int, stride: int, residual: bool) -> int:
    """Count graph, two norms, five frames of convolution, and the shortcut."""
    count = graph(into, out) + 4 * out + 5 * out * out + out
    return count + (into * out + 3 * out if residual and (into != out or stride > 1) else 0)


def dense(into: int, out: int) -> int:
    return into * out + out


def encoder(channels: list[int]) -> int:
    strides = [1, 2, 2, 2, 1]
    rows = zip(channels, channels[1:], strides, strict=False)
    return sum(st_gcn(a, b, s, number > 0) for number, (a, b, s) in enumerate(rows))


def g_gru(into: int) -> int:
    """Count three gates in with bias, the message, three gates of it, and the links' masks."""
    return 3 * dense(into, 256) + 256 * 256 + 3 * 256 * 256 + 2 * N * N


HEAD = dense(256, 256) + dense(256, 256) + dense(256, 3)


def size(module) -> int:
    return sum(weight.numel() for weight in module.parameters())


@pytest.mark.parametrize(("role", "into", "table"), [(0, 4, 11), (1, 3, 13)])
def test_st_gcn_1_and_2_are_tables_11_and_13(role, into, table):
    form = model("paper")
    who = (form.first, form.second)[role]
    asked = given(form, role)
    found, code = shapes(who.encoder.layers, lambda: who.encode(asked.template, asked, None))
    channels = [32, 64, 128, 256, 256]
    assert found == [(t, N, B, c) for t, c in zip(HALVES, channels, strict=True)]
    assert code.mean.shape == code.log_variance.shape == (B, N, 256)
    assert size(who.encoder) == encoder([into, *channels])


def test_table_11_ends_in_262_channels_and_a_dense_layer():
    form = model("paper")
    assert size(form.first.posterior) == 2 * dense(262, 256)  # two heads where the table has one


def test_st_gcn_3_is_table_14_and_the_fusion_table_15():
    form = model("paper")
    asked = given(form, 1)
    found, _ = shapes(
        form.second.partner_encoder.layers, lambda: form.second.encode(asked.template, asked, None)
    )
    assert found == [(t, N, B, 16) for t in HALVES]
    assert size(form.second.partner_encoder) == encoder([8, 16, 16, 16, 16, 16])
    assert size(form.second.fusion) == dense(278, 256)
    assert size(form.second.posterior) == 2 * dense(256, 256)


@pytest.mark.parametrize(("role", "into", "table"), [(0, 10, 12), (1, 25, 16)])
def test_the_g_grus_are_tables_12_and_16(role, into, table):
    form = model("paper")
    who = (form.first, form.second)[role]
    asked = given(form, role)
    assert who.latent_shape(asked) == (B, N, 256)
    layers = who.decoder.head.layers
    found, field = shapes(layers, lambda: who.decode(torch.zeros(B, N, 256), asked))
    assert len(found) == 3 * T  # frame by frame
    assert [shape[-1] for shape in found[:3]] == [256, 256, 3]
    assert field.shape == (B, T, N, 3)
    assert size(who.decoder) == g_gru(into) + HEAD


def test_the_whole_paper_form_is_as_large_as_its_tables():
    form = model("paper")
    wanted = (
        encoder([4, 32, 64, 128, 256, 256]) + 2 * dense(262, 256) + g_gru(10) + HEAD
        + encoder([3, 32, 64, 128, 256, 256]) + encoder([8, 16, 16, 16, 16, 16])
        + dense(278, 256) + 2 * dense(256, 256) + g_gru(25) + HEAD
    )  # fmt: skip
    assert size(form.first) + size(form.second) == wanted


def line(into: int, out: int, kernel: int = 3) -> int:
    return dense(kernel * into, out)


def lines(*channels: int) -> int:
    return sum(line(a, b) for a, b in pairwise(channels))


def graphs(*channels: int) -> int:
    return sum(graph(a, b) for a, b in pairwise(channels))


def planes(*channels: int) -> int:
    return sum(line(a, b, 9) for a, b in pairwise(channels))


def stack(first: bool, *channels: int) -> int:
    rows = enumerate(pairwise(channels))
    return sum(st_gcn(a, b, 1, not (first and number == 0)) for number, (a, b) in rows)


WANTED = {
    ("f_cnn", 0): lines(3, 32, 64, 128, 256) + 2 * dense(260, 256) + dense(260, 256)
    + lines(256, 256, 128, 32) + dense(32, 3),
    ("f_cnn", 1): lines(3, 32, 64, 128, 256) + 2 * dense(264, 256) + dense(264, 256)
    + lines(256, 128, 64, 32) + dense(32, 3),
    ("f_gcn", 0): graphs(3, 32, 64) + dense(4, 20) + graph(84, 128) + 2 * graph(128, 256)
    + graphs(276, 256, 128, 64, 32, 3) + dense(3, 3),
    ("f_gcn", 1): graphs(3, 32, 64) + dense(6, 16) + graph(80, 128) + 2 * graph(128, 256)
    + graphs(272, 256, 128, 64, 32, 3) + dense(3, 3),
    ("m_cnn", 0): planes(4, 16, 32) + 2 * planes(32, 64) + dense(65, 64) + planes(64, 32, 16, 3)
    + dense(3, 3),
    ("m_cnn", 1): dense(3, 8) + planes(16, 32) + 2 * planes(32, 64) + dense(72, 64)
    + planes(64, 32, 16) + dense(16, 3),
    ("m_gcn", 0): stack(True, 4, 32, 64, 128) + 2 * dense(128, 128)
    + stack(False, 129, 128, 64, 32, 16, 3),
    ("m_gcn", 1): stack(True, 3, 32, 64, 128) + dense(6, 16) + 2 * dense(144, 128)
    + stack(False, 144, 128, 64, 32) + dense(32, 3),
}  # fmt: skip


@pytest.mark.parametrize(("name", "role"), WANTED)
def test_the_baselines_are_tables_17_to_20(name, role):
    form = model(name)
    assert size((form.first, form.second)[role]) == WANTED[name, role]


LATENTS = {
    "f_cnn": (B, T, 4, 256),
    "f_gcn": (B, T, N, 256),
    "m_cnn": (B, T, N, 64),
    "m_gcn": (B, T, N, 128),
}


@pytest.mark.parametrize("role", [0, 1])
@pytest.mark.parametrize("name", LATENTS)
def test_the_baselines_latents_have_the_tables_shapes(name, role):
    form = model(name)
    who, asked = (form.first, form.second)[role], given(form, role)
    with torch.no_grad():
        code = who.encode(asked.template, asked, None)
        field = who.decode(torch.zeros(who.latent_shape(asked)), asked)
    assert code.mean.shape == code.log_variance.shape == who.latent_shape(asked) == LATENTS[name]
    assert field.shape == (B, T, N, 3)


def test_a_frame_cnn_halves_joints_as_its_table_and_comes_back():
    form = model("f_cnn")
    assert form.first.sizes == [25, 13, 7, 4]
    found, _ = shapes(
        form.first.decoder, lambda: form.first.decode(torch.zeros(B, T, 4, 256), given(form, 0))
    )
    assert found == [(B, T, 7, 256), (B, T, 13, 128), (B, T, 25, 32)]


@pytest.mark.parametrize("name", model_names("skeleton_prior"))
def test_every_weight_of_every_model_has_a_slope(name):
    # Wide enough that no layer is dead by chance: of four channels behind a ReLU, one time in ten.
    form, random = model(name).train(), generator()
    initialise_weights(form, random)
    for layer in form.modules():
        if isinstance(layer, ZeroInitLinear):  # so is all before it until it has learnt
            torch.nn.init.normal_(layer.weight, generator=random)
    template = torch.randn(B, 9, 2, N, 3, generator=random)
    scales = 1 + 0.1 * torch.rand(B, 2, N, generator=random)
    varied = template + 0.1 * torch.randn(template.shape, generator=random)
    answer = form.reconstruct(template, scales, varied, random)
    loss = answer.motions.square().mean() + sum(code.kl_divergence() for code in answer.posteriors)
    loss.backward()
    learnt = [(n, w) for n, w in form.named_parameters() if not n.startswith("skeleton_vae")]
    flat = [name for name, weight in learnt if weight.grad is None or not weight.grad.any()]
    assert flat == []


def test_an_unknown_model_is_refused_by_name():
    with pytest.raises(ValueError, match="model must be one of kinematic, paper, f_cnn.*'mlp'"):
        build_skeleton_prior(PriorConfig(NTU25, LIMBS, "mlp", 32, 1, 30.0, 0.0))
