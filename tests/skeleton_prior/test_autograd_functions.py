"""Oracle: float64, for either library; and float64 to eight bits in mixed precision."""

from pathlib import Path

import pytest
import torch

from pacmo_core.data.skeleton import SBU15
from pacmo_core.skeleton_prior import autograd_functions
from pacmo_core.skeleton_prior.layers import (
    ConcatLinear,
    GraphConvolution,
    GraphGru,
    TemporalConvolution,
    normalised_adjacency,
    off_diagonal_adjacency,
)
from tests.skeleton_prior.examples import generator, randomised

LAYERS = {
    "dense": (lambda: ConcatLinear(7, 5), [(2, 15, 4, 3), (2, 15, 4, 4)]),
    "graph convolution, wider": (
        lambda: GraphConvolution(off_diagonal_adjacency(SBU15), 3, 8),
        [(2, 15, 4, 3)],
    ),
    "graph convolution, narrower": (
        lambda: GraphConvolution(off_diagonal_adjacency(SBU15), 8, 3),
        [(2, 15, 4, 8)],
    ),
    "time convolution": (lambda: TemporalConvolution(4, 6, stride=2), [(7, 15, 4, 4)]),
    "graph gated recurrent unit": (
        lambda: GraphGru(normalised_adjacency(SBU15), 5, 8),
        [(3, 15, 4, 5), (15, 4, 8)],
    ),
}


@pytest.fixture(autouse=True, params=["torch", "onednn"])
def library(request, monkeypatch):
    if request.param == "onednn" and not torch.backends.mkldnn.is_available():
        pytest.skip("this build of torch is without oneDNN")
    monkeypatch.setattr(autograd_functions, "_mkl_is_slow", lambda: request.param == "onednn")
    return request.param


def assert_near(got, expected):
    assert got.dtype == torch.float32
    torch.testing.assert_close(got.double(), expected, atol=1e-4, rtol=1e-4)


@pytest.mark.parametrize("bias", [torch.randn(6, generator=generator(3)), None])
def test_a_linear_product_takes_weights_of_any_memory_layout(bias):
    x = torch.randn(3, 4, 5, generator=generator())
    wide = torch.randn(6, 9, generator=generator(1))
    for weight in (wide[:, :5].contiguous(), wide[:, 2:7], wide[:, :5].T.contiguous().T):
        expected = torch.einsum("abc,dc->abd", x.double(), weight.double())
        assert_near(
            autograd_functions.linear(x, weight, bias),
            expected if bias is None else expected + bias.double(),
        )
        out = torch.ones(3, 4, 6)
        autograd_functions.add_linear(out, x, weight)
        assert_near(out, 1 + expected)


@pytest.mark.parametrize("n_rows", [1, 24, 25, 26, 517])
def test_the_weight_gradient_is_a_sum_over_all_rows(n_rows):
    left = torch.randn(n_rows, 2, 9, generator=generator())[:, :1]
    right = torch.randn(n_rows, 1, 6, generator=generator(1))
    expected = torch.einsum("abd,abc->dc", left.double(), right.double())
    assert_near(autograd_functions.weight_gradient(left, right), expected)


def output_and_gradients(name, dtype, *, rounds=False):
    """Return a layer's output and the gradients of its inputs and weights."""
    build, shapes = LAYERS[name]
    layer = randomised(build()).to(dtype)
    drawn = [torch.randn(shape, generator=generator(5)) for shape in shapes]
    given = [value.to(dtype).requires_grad_() for value in drawn]
    with autograd_functions.bfloat16_products(rounds):
        out = layer(*given)
    (out * out.detach().cos()).sum().backward()
    return [out.detach(), *(v.grad for v in [*given, *layer.parameters()])]


@pytest.mark.parametrize("name", LAYERS)
def test_a_layer_and_its_gradients_are_those_of_float64(name):
    result = (output_and_gradients(name, dtype) for dtype in (torch.float32, torch.float64))
    for single, double in zip(*result, strict=True):
        assert_near(single, double)


@pytest.mark.parametrize("name", LAYERS)
def test_mixed_precision_is_accurate_to_eight_bits(name, monkeypatch):
    monkeypatch.setattr(autograd_functions, "supports_bfloat16", lambda device: True)
    result = output_and_gradients(name, torch.float32, rounds=True)
    assert all(gradient.dtype == torch.float32 for gradient in result[1:])
    for rounded, double in zip(result, output_and_gradients(name, torch.float64), strict=True):
        assert (rounded - double).norm() < 2**-6 * double.norm()
    exact = output_and_gradients(name, torch.float32)
    assert not torch.equal(result[0], exact[0]) and not torch.equal(result[1], exact[1])


@pytest.mark.parametrize("name", LAYERS)
def test_there_is_no_rounding_in_float64_nor_without_support(name, monkeypatch):
    for dtype, has in ((torch.float32, False), (torch.float64, True)):
        monkeypatch.setattr(autograd_functions, "supports_bfloat16", lambda device, has=has: has)
        result = output_and_gradients(name, dtype, rounds=True)
        for rounded, exact in zip(result, output_and_gradients(name, dtype), strict=True):
            assert torch.equal(rounded, exact)


def test_bfloat16_support_follows_the_processors_flags():
    listed = Path("/proc/cpuinfo")
    if not listed.exists():
        pytest.skip("no /proc/cpuinfo")
    assert autograd_functions.supports_bfloat16("cpu") <= ("avx512_bf16" in listed.read_text())


def test_onednn_is_used_in_float32_where_mkl_is_slow(library, monkeypatch):
    calls = []
    linear = torch.nn.functional.linear
    monkeypatch.setattr(
        torch.nn.functional, "linear", lambda *given: calls.append(given) or linear(*given)
    )
    x, weight = torch.ones(2, 3), torch.ones(4, 3)
    autograd_functions.linear(x, weight)
    assert len(calls) == (1 if library == "torch" else 0)
    autograd_functions.linear(x.double(), weight.double())
    assert len(calls) == (2 if library == "torch" else 1)
