"""Products of matrices along channels, joints and time, with gradients that copy nothing.

What autograd would do of itself is the same arithmetic; but it would gather a frame's neighbours
side by side, forwards and backwards, and to fetch the memory for that costs more than to multiply.

Torch's own products are MKL's, which goes by who made a processor: of one with vectors of 512 bits
that is not Intel's it leaves half idle. There products along channels are oneDNN's, which goes by
what a processor can do.

While a model learns, factors may be rounded to bfloat16 (``rounding``), which a processor that has
it multiplies twice as fast. What comes of them is rounded too, and what is made of that, so that
half as many bytes go through memory, until somebody takes it for ``exact``; sums are float32's.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

# Rows to an image, of those that oneDNN takes for an image: with so many it is at its best.
ROWS_PER_IMAGE = 25

_bfloat16_enabled = ContextVar("_rounds", default=False)


@contextmanager
def bfloat16_products(wanted: bool) -> Iterator[None]:
    """Round factors of float32 to bfloat16, those too of the gradients of what is done within.

    Where the device does not multiply bfloat16 (``has_bfloat16``), products stay as they are.
    """
    before = _bfloat16_enabled.set(wanted)
    try:
        yield
    finally:
        _bfloat16_enabled.reset(before)


@cache
def supports_bfloat16(device: str) -> bool:
    """Say whether a kind of device, ``cpu`` or ``cuda``, has instructions for such products."""
    if device == "cuda":
        return bool(torch.cuda.is_bf16_supported(including_emulation=False))
    wide = torch.backends.cpu.get_cpu_capability() == "AVX512"
    return wide and bool(torch.cpu.get_capabilities().get("avx512_bf16"))


def cast_factor(x: Tensor) -> Tensor:
    """Take a tensor as products want it: contiguous, and rounded where that is wanted."""
    if _bfloat16_enabled.get() and x.dtype == torch.float32 and supports_bfloat16(x.device.type):
        return x.to(torch.bfloat16, memory_format=torch.contiguous_format)
    return x.contiguous()


def to_float32(x: Tensor) -> Tensor:
    """Take what comes of rounded factors as float32, all else as it is."""
    return x.float() if x.dtype == torch.bfloat16 else x


@cache
def _mkl_is_slow() -> bool:
    described = Path("/proc/cpuinfo")
    wide = torch.backends.cpu.get_cpu_capability() == "AVX512"
    others = described.exists() and "GenuineIntel" not in described.read_text()
    return wide and others and bool(torch.backends.mkldnn.is_available())  # type: ignore[no-untyped-call]  # torch leaves it untyped


def _uses_onednn(x: Tensor) -> bool:
    return x.dtype == torch.float32 and x.device.type == "cpu" and _mkl_is_slow()


def linear(x: Tensor, weight: Tensor, bias: Tensor | None = None) -> Tensor:
    """``X Wᵀ + b``, of (..., C), (D, C) and (D,); gradients are the caller's.

    Of rounded ``X`` it is float32 all the same.
    """
    return to_float32(_linear(x, weight, bias))


def add_linear(out: Tensor, x: Tensor, weight: Tensor) -> None:
    """Add ``X Wᵀ`` to ``(..., D)`` in place."""
    if x.dtype == torch.bfloat16 or _uses_onednn(x):
        out += _linear(x, weight)
    else:
        flatten_rows(out).addmm_(flatten_rows(x), weight.T)


def _linear(x: Tensor, weight: Tensor, bias: Tensor | None = None) -> Tensor:
    """``X Wᵀ + b`` of the kind of ``X``."""
    weight, bias = weight.to(x.dtype), None if bias is None else bias.to(x.dtype)
    if not _uses_onednn(x):
        return nn.functional.linear(x, weight, bias)
    # Of weights that are a part of wider ones it has a plain loop, a thousand times slower.
    whole = weight if weight.T.is_contiguous() else weight.contiguous()
    out: Tensor = torch.ops.mkldnn._linear_pointwise(x, whole, bias, "none", [], "")
    return out


def weight_gradient(left: Tensor, right: Tensor) -> Tensor:
    """``Xᵀ Y``, (D, C), of (..., D) and (..., C): how the weights of a product are to change.

    oneDNN has it as the slope of a convolution's weights, of one pixel.
    """
    left, right = left.reshape(-1, left.shape[-1]), right.reshape(-1, right.shape[-1])
    if right.dtype == torch.bfloat16:
        return to_float32(left.bfloat16().T @ right)
    n_images = len(left) // ROWS_PER_IMAGE if _uses_onednn(left) else 0
    n = n_images * ROWS_PER_IMAGE
    total = left[n:].T @ right[n:]
    if n_images:
        images = [
            x[:n].view(n_images, ROWS_PER_IMAGE, 1, -1).permute(0, 3, 1, 2) for x in (left, right)
        ]
        geometry = (1, 1), (0, 0), (1, 1), False, (0, 0), 1
        weight, only = total[..., None, None], (False, True, False)
        slopes = torch.ops.aten.convolution_backward(*images, weight, None, *geometry, only)
        total += slopes[1][..., 0, 0]
    return total


class LinearFunction(torch.autograd.Function):
    """``X Wᵀ + b`` of channels in several parts: to join them would copy them and their slopes."""

    @staticmethod
    def forward(ctx: Any, weight: Tensor, bias: Tensor | None, *parts: Tensor) -> Tensor:
        """``(..., C1)``, ``(..., C2)``, ... to ``(..., D)``.

        Parameters
        ----------
        weight : (D, C1 + C2 + ...)
        bias : (D,) or none
        """
        parts = tuple(cast_factor(part) for part in parts)
        first, *others = _split_weight(weight, parts)
        out = _linear(parts[0], first, bias)
        for part, share in zip(parts[1:], others, strict=True):
            add_linear(out, part, share)
        ctx.save_for_backward(weight, *parts)
        return out

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        """Give the gradients of weight, bias and all parts."""
        weight, *parts = ctx.saved_tensors
        _, biased, *wanted = ctx.needs_input_grad
        gradient = gradients[0].contiguous()
        d_weight = torch.cat([weight_gradient(gradient, part) for part in parts], dim=1)
        back = [
            _linear(gradient, share.T) if want else None
            for share, want in zip(_split_weight(weight, parts), wanted, strict=True)
        ]
        return d_weight, to_float32(flatten_rows(gradient).sum(dim=0)) if biased else None, *back


def _split_weight(weight: Tensor, parts: Sequence[Tensor]) -> tuple[Tensor, ...]:
    return torch.split(weight, [part.shape[-1] for part in parts], dim=1)


def multiply_joints(links: Tensor, x: Tensor) -> Tensor:
    """``links X``, of (J, J) and (..., J, C) of few channels.

    One product of all frames: as a product a frame, of so few channels, it takes six times as long.
    """
    return (x.mT.contiguous() @ links.T).mT


def flatten_rows(x: Tensor) -> Tensor:
    """``(..., C)`` to the rows of one matrix, (N, C), where they lie."""
    return x.view(-1, x.shape[-1])


class GraphConvolutionFunction(torch.autograd.Function):
    """``links X W + X U + b`` over the joints, the second axis of three or more."""

    @staticmethod
    def forward(
        ctx: Any, x: Tensor, links: Tensor, along: Tensor, own: Tensor, bias: Tensor
    ) -> Tensor:
        """``(T, J, ..., C)`` to ``(T, J, ..., D)``.

        Parameters
        ----------
        links : (J, J)
        along, own : (D, C)
        bias : (D,)
        """
        x = cast_factor(x)
        # The narrower side is mixed over joints: mixing commutes with the weights.
        inside = along.shape[1] <= along.shape[0]
        out = _linear(x, own, bias)
        if inside:
            mixed = _multiply_adjacency(links, x)
            add_linear(out, mixed, along)
        else:
            mixed = _linear(x, along)
            _add_multiplied(out, links, mixed)
        ctx.inside = inside
        ctx.save_for_backward(x, mixed, links, along, own)
        return out

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        """Give the gradients of all five."""
        x, mixed, links, along, own = ctx.saved_tensors
        gradient = gradients[0].contiguous()
        back = _linear(gradient, own.T) if ctx.needs_input_grad[0] else None
        if ctx.inside:
            through = _linear(gradient, along.T)
            d_links, d_along = _adjacency_gradient(through, x), weight_gradient(gradient, mixed)
            if back is not None:
                _add_multiplied(back, links.T, through)
        else:
            through = _multiply_adjacency(links.T, gradient)
            d_links, d_along = _adjacency_gradient(gradient, mixed), weight_gradient(through, x)
            if back is not None:
                add_linear(back, through, along.T)
        return (
            back,
            d_links,
            d_along,
            weight_gradient(gradient, x),
            to_float32(flatten_rows(gradient).sum(dim=0)),
        )


class TemporalConvolutionFunction(torch.autograd.Function):
    """A convolution over time, the first axis, centred; what is beyond the ends is zero.

    torch's own, but for the weights' gradient, which takes less time a frame of the kernel at once.
    """

    @staticmethod
    def forward(ctx: Any, x: Tensor, kernel: Tensor, bias: Tensor, stride: int) -> Tensor:
        """``(T, J, B, C)`` to ``(ceil(T / stride), J, B, D)``.

        Parameters
        ----------
        kernel : (D, K, C), of K frames, an odd number
        bias : (D,)
        stride : frames in to one out
        """
        x = cast_factor(x)
        ctx.stride = stride
        ctx.save_for_backward(x, kernel)
        taps, rounded = _conv2d_weight(kernel).to(x.dtype), bias.to(x.dtype)
        out = torch.conv2d(_to_image(x), taps, rounded, *_stride_and_padding(kernel, stride))
        return _from_image(out, x)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        """Give the gradients of all three."""
        x, kernel = ctx.saved_tensors
        gradient = gradients[0].contiguous()
        d_kernel, stride = torch.zeros_like(kernel), ctx.stride
        for tap, shift in enumerate(range(-(kernel.shape[1] // 2), kernel.shape[1] // 2 + 1)):
            # Frames out whose frame in, so far away, is there.
            first = max(0, -(shift // stride))
            last = min(len(gradient), (len(x) - 1 - shift) // stride + 1)
            if first < last:
                seen = x[first * stride + shift :: stride][: last - first]
                d_kernel[:, tap] = weight_gradient(gradient[first:last], seen)
        back = None
        if ctx.needs_input_grad[0]:
            taps, only = _conv2d_weight(kernel).to(x.dtype), (True, False, False)
            args = (
                _to_image(gradient),
                _to_image(x),
                taps,
                None,
                *_stride_and_padding(kernel, stride),
            )
            image = torch.ops.aten.convolution_backward(*args, (1, 1), False, (0, 0), 1, only)[0]
            back = _from_image(image, x)
        return back, d_kernel, to_float32(flatten_rows(gradient).sum(dim=0)), None


def _to_image(x: Tensor) -> Tensor:
    """As high as time and as wide as joints and rows; in memory channels stay last."""
    return x.view(1, len(x), -1, x.shape[-1]).permute(0, 3, 1, 2)


def _from_image(image: Tensor, like: Tensor) -> Tensor:
    return image.permute(0, 2, 3, 1).reshape(-1, *like.shape[1:-1], image.shape[1])


def _conv2d_weight(kernel: Tensor) -> Tensor:
    return kernel.transpose(1, 2)[..., None].contiguous()


def _stride_and_padding(kernel: Tensor, stride: int) -> tuple[tuple[int, int], tuple[int, int]]:
    return (stride, 1), (kernel.shape[1] // 2, 0)


def _flatten_frames(x: Tensor) -> Tensor:
    return x.view(*x.shape[:2], -1)


def _expand_adjacency(links: Tensor, x: Tensor) -> Tensor:
    return links.to(x.dtype).expand(len(x), *links.shape)


def _multiply_adjacency(links: Tensor, x: Tensor) -> Tensor:
    """``links X`` of each frame."""
    return torch.bmm(_expand_adjacency(links, x), _flatten_frames(x)).view_as(x)


def _add_multiplied(out: Tensor, links: Tensor, x: Tensor) -> None:
    if x.dtype == torch.bfloat16:
        out += _multiply_adjacency(links, x)
    else:
        _flatten_frames(out).baddbmm_(_expand_adjacency(links, x), _flatten_frames(x))


def _adjacency_gradient(left: Tensor, right: Tensor) -> Tensor:
    """Sum over all frames of ``(J, N) (J, N)ᵀ``."""
    return to_float32(torch.bmm(_flatten_frames(left), _flatten_frames(right).mT)).sum(dim=0)
