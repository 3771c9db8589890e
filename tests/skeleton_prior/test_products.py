"""What is trusted: the same sums in float64, whichever library multiplies."""

import pytest
import torch

from pacmo_core.skeleton import SBU15
from pacmo_core.skeleton_prior import products
from pacmo_core.skeleton_prior.graph import adjacency, neighbours
from pacmo_core.skeleton_prior.layers import Dense, GraphConvolution, TimeConvolution
from pacmo_core.skeleton_prior.recurrence import GraphGru
from tests.skeleton_prior.bodies import generator, shaken

LAYERS = {
    "dense": (lambda: Dense(7, 5), [(2, 15, 4, 3), (2, 15, 4, 4)]),
    "graph convolution, wider": (
        lambda: GraphConvolution(neighbours(SBU15), 3, 8),
        [(2, 15, 4, 3)],
    ),
    "graph convolution, narrower": (
        lambda: GraphConvolution(neighbours(SBU15), 8, 3),
        [(2, 15, 4, 8)],
    ),
    "time convolution": (lambda: TimeConvolution(4, 6, stride=2), [(7, 15, 4, 4)]),
    "graph gated recurrent unit": (
        lambda: GraphGru(adjacency(SBU15), 5, 8),
        [(3, 15, 4, 5), (15, 4, 8)],
    ),
}


@pytest.fixture(autouse=True, params=["torch", "onednn"])
def library(request, monkeypatch):
    if request.param == "onednn" and not torch.backends.mkldnn.is_available():
        pytest.skip("this build of torch is without oneDNN")
    monkeypatch.setattr(products, "_mkl_is_slow", lambda: request.param == "onednn")
    return request.param


def near(got, wanted):
    assert got.dtype == torch.float32
    torch.testing.assert_close(got.double(), wanted, atol=1e-4, rtol=1e-4)


@pytest.mark.parametrize("bias", [torch.randn(6, generator=generator(3)), None])
def test_a_dense_product_takes_weights_however_they_lie(bias):
    x = torch.randn(3, 4, 5, generator=generator())
    wide = torch.randn(6, 9, generator=generator(1))
    for weight in (wide[:, :5].contiguous(), wide[:, 2:7], wide[:, :5].T.contiguous().T):
        wanted = torch.einsum("abc,dc->abd", x.double(), weight.double())
        near(products.dense(x, weight, bias), wanted if bias is None else wanted + bias.double())
        out = torch.ones(3, 4, 6)
        products.add_dense(out, x, weight)
        near(out, 1 + wanted)


@pytest.mark.parametrize("n_rows", [1, 24, 25, 26, 517])
def test_the_change_of_weights_is_a_sum_over_all_rows(n_rows):
    left = torch.randn(n_rows, 2, 9, generator=generator())[:, :1]
    right = torch.randn(n_rows, 1, 6, generator=generator(1))
    wanted = torch.einsum("abd,abc->dc", left.double(), right.double())
    near(products.outer(left, right), wanted)


@pytest.mark.parametrize("name", LAYERS)
def test_a_layer_and_its_gradients_are_those_of_float64(name):
    build, shapes = LAYERS[name]
    inputs = [torch.randn(shape, generator=generator(5)) for shape in shapes]
    found = []
    for dtype in (torch.float32, torch.float64):
        layer = shaken(build()).to(dtype)
        given = [value.detach().to(dtype).requires_grad_() for value in inputs]
        out = layer(*given)
        (out * out.detach().cos()).sum().backward()
        found.append([out.detach(), *(v.grad for v in [*given, *layer.parameters()])])
    for single, double in zip(*found, strict=True):
        near(single, double)


def test_torch_is_asked_where_it_is_as_fast_and_for_what_onednn_has_not(library, monkeypatch):
    asked = []
    linear = torch.nn.functional.linear
    monkeypatch.setattr(
        torch.nn.functional, "linear", lambda *given: asked.append(given) or linear(*given)
    )
    x, weight = torch.ones(2, 3), torch.ones(4, 3)
    products.dense(x, weight)
    assert len(asked) == (1 if library == "torch" else 0)
    products.dense(x.double(), weight.double())
    assert len(asked) == (2 if library == "torch" else 1)
