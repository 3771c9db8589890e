"""Autograd functions: linear layer, graph convolution, temporal convolution and graph GRU.

They compute what autograd would, but their gradients copy nothing. Autograd would gather each
frame's neighbours side by side in the forward and the backward pass, and allocating that memory
takes longer than the products.

torch's matrix products use MKL, which selects instructions by the processor's vendor and uses half
of an AVX-512 processor that is not Intel's. There, products along channels use oneDNN, which
selects by instruction set.

In mixed precision (``bfloat16_products``) the factors of products are rounded to bfloat16, which
AVX512-BF16 multiplies twice as fast. Products of rounded factors are bfloat16 too, and so are
results of layers computed from them, until ``to_float32``; sums accumulate in float32.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

# oneDNN computes a weight gradient as a convolution over images of this many rows: the fastest.
ROWS_PER_IMAGE = 25

_bfloat16_enabled = ContextVar("_bfloat16_enabled", default=False)


@contextmanager
def bfloat16_products(enabled: bool) -> Iterator[None]:
    """Round float32 factors of products to bfloat16 in this block, and in its gradients.

    Has no effect on a device that does not support it (``supports_bfloat16``).
    """
    token = _bfloat16_enabled.set(enabled)
    try:
        yield
    finally:
        _bfloat16_enabled.reset(token)


@cache
def supports_bfloat16(device: str) -> bool:
    """Check whether a device type, ``cpu`` or ``cuda``, has instructions for bfloat16 products."""
    if device == "cuda":
        return bool(torch.cuda.is_bf16_supported(including_emulation=False))
    avx512 = torch.backends.cpu.get_cpu_capability() == "AVX512"
    return avx512 and bool(torch.cpu.get_capabilities().get("avx512_bf16"))


def cast_factor(x: Tensor) -> Tensor:
    """Make a factor contiguous, and round it to bfloat16 where that is enabled and supported."""
    if _bfloat16_enabled.get() and x.dtype == torch.float32 and supports_bfloat16(x.device.type):
        return x.to(torch.bfloat16, memory_format=torch.contiguous_format)
    return x.contiguous()


def to_float32(x: Tensor) -> Tensor:
    """Convert bfloat16 to float32; other dtypes are unchanged."""
    return x.float() if x.dtype == torch.bfloat16 else x


@cache
def _mkl_is_slow() -> bool:
    cpuinfo = Path("/proc/cpuinfo")
    avx512 = torch.backends.cpu.get_cpu_capability() == "AVX512"
    not_intel = cpuinfo.exists() and "GenuineIntel" not in cpuinfo.read_text()
    return avx512 and not_intel and bool(torch.backends.mkldnn.is_available())  # type: ignore[no-untyped-call]  # torch leaves it untyped


def _uses_onednn(x: Tensor) -> bool:
    return x.dtype == torch.float32 and x.device.type == "cpu" and _mkl_is_slow()


def linear(x: Tensor, weight: Tensor, bias: Tensor | None = None) -> Tensor:
    """Compute ``X W^T + b`` in float32, of (..., C), (D, C) and (D,), without autograd."""
    return to_float32(_linear(x, weight, bias))


def add_linear(out: Tensor, x: Tensor, weight: Tensor) -> None:
    """Add ``X W^T`` to ``(..., D)`` in place."""
    if x.dtype == torch.bfloat16 or _uses_onednn(x):
        out += _linear(x, weight)
    else:
        flatten_rows(out).addmm_(flatten_rows(x), weight.T)


def _linear(x: Tensor, weight: Tensor, bias: Tensor | None = None) -> Tensor:
    """Compute ``X W^T + b`` in the dtype of ``X``."""
    weight, bias = weight.to(x.dtype), None if bias is None else bias.to(x.dtype)
    if not _uses_onednn(x):
        return nn.functional.linear(x, weight, bias)
    # oneDNN is a thousand times slower on weights that are a slice of a wider matrix.
    weight = weight if weight.T.is_contiguous() else weight.contiguous()
    out: Tensor = torch.ops.mkldnn._linear_pointwise(x, weight, bias, "none", [], "")
    return out


def weight_gradient(left: Tensor, right: Tensor) -> Tensor:
    """Compute ``X^T Y``, (D, C) float32, of (..., D) and (..., C): a weight's gradient.

    In oneDNN that is the weight gradient of a 1 x 1 convolution.
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
        weight, only_weight = total[..., None, None], (False, True, False)
        gradients = torch.ops.aten.convolution_backward(
            *images, weight, None, *geometry, only_weight
        )
        total += gradients[1][..., 0, 0]
    return total


def multiply_joints(matrix: Tensor, x: Tensor) -> Tensor:
    """Compute ``M X`` over the joints, of (J, J) and (..., J, C) with few channels.

    One product for all frames: one product per frame takes six times as long with few channels.
    """
    return (x.mT.contiguous() @ matrix.T).mT


def flatten_rows(x: Tensor) -> Tensor:
    """View ``(..., C)`` as a matrix (N, C)."""
    return x.view(-1, x.shape[-1])


class LinearFunction(torch.autograd.Function):
    """``X W^T + b``, X being several tensors side by side in the channels, without joining them."""

    @staticmethod
    def forward(ctx: Any, weight: Tensor, bias: Tensor | None, *parts: Tensor) -> Tensor:
        """Map ``(..., C1)``, ``(..., C2)``, ... to ``(..., D)``.

        Parameters
        ----------
        weight : (D, C1 + C2 + ...)
        bias : (D,) or none
        """
        parts = tuple(cast_factor(part) for part in parts)
        first, *others = _split_weight(weight, parts)
        out = _linear(parts[0], first, bias)
        for part, part_weight in zip(parts[1:], others, strict=True):
            add_linear(out, part, part_weight)
        ctx.save_for_backward(weight, *parts)
        return out

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        """Compute the gradients of weight, bias and all parts."""
        weight, *parts = ctx.saved_tensors
        _, bias_needed, *needed = ctx.needs_input_grad
        gradient = gradients[0].contiguous()
        d_weight = torch.cat([weight_gradient(gradient, part) for part in parts], dim=1)
        d_parts = [
            _linear(gradient, part_weight.T) if part_needed else None
            for part_weight, part_needed in zip(_split_weight(weight, parts), needed, strict=True)
        ]
        d_bias = to_float32(flatten_rows(gradient).sum(dim=0)) if bias_needed else None
        return d_weight, d_bias, *d_parts


def _split_weight(weight: Tensor, parts: Sequence[Tensor]) -> tuple[Tensor, ...]:
    return torch.split(weight, [part.shape[-1] for part in parts], dim=1)


class GraphConvolutionFunction(torch.autograd.Function):
    """``A X W + X U + b`` over the joints, the second axis of three or more."""

    @staticmethod
    def forward(
        ctx: Any,
        x: Tensor,
        adjacency: Tensor,
        neighbour_weight: Tensor,
        self_weight: Tensor,
        bias: Tensor,
    ) -> Tensor:
        """Map ``(T, J, ..., C)`` to ``(T, J, ..., D)``.

        Parameters
        ----------
        adjacency : (J, J)
        neighbour_weight, self_weight : (D, C)
        bias : (D,)
        """
        x = cast_factor(x)
        # Products over joints and channels commute: over joints on the side of fewer channels.
        adjacency_first = neighbour_weight.shape[1] <= neighbour_weight.shape[0]
        out = _linear(x, self_weight, bias)
        if adjacency_first:
            intermediate = _multiply_adjacency(adjacency, x)
            add_linear(out, intermediate, neighbour_weight)
        else:
            intermediate = _linear(x, neighbour_weight)
            _add_multiplied(out, adjacency, intermediate)
        ctx.adjacency_first = adjacency_first
        ctx.save_for_backward(x, intermediate, adjacency, neighbour_weight, self_weight)
        return out

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        """Compute the gradients of all five tensors."""
        x, intermediate, adjacency, neighbour_weight, self_weight = ctx.saved_tensors
        gradient = gradients[0].contiguous()
        d_x = _linear(gradient, self_weight.T) if ctx.needs_input_grad[0] else None
        if ctx.adjacency_first:
            d_intermediate = _linear(gradient, neighbour_weight.T)
            d_adjacency = _adjacency_gradient(d_intermediate, x)
            d_neighbour = weight_gradient(gradient, intermediate)
            if d_x is not None:
                _add_multiplied(d_x, adjacency.T, d_intermediate)
        else:
            d_intermediate = _multiply_adjacency(adjacency.T, gradient)
            d_adjacency = _adjacency_gradient(gradient, intermediate)
            d_neighbour = weight_gradient(d_intermediate, x)
            if d_x is not None:
                add_linear(d_x, d_intermediate, neighbour_weight.T)
        d_bias = to_float32(flatten_rows(gradient).sum(dim=0))
        return d_x, d_adjacency, d_neighbour, weight_gradient(gradient, x), d_bias


class TemporalConvolutionFunction(torch.autograd.Function):
    """A centred convolution over time, the first axis, with zero padding.

    Uses torch's convolution, except for the weight gradient, which is faster per kernel frame.
    """

    @staticmethod
    def forward(ctx: Any, x: Tensor, kernel: Tensor, bias: Tensor, stride: int) -> Tensor:
        """Map ``(T, J, B, C)`` to ``(ceil(T / stride), J, B, D)``.

        Parameters
        ----------
        kernel : (D, K, C), of K frames, an odd number
        bias : (D,)
        stride : frames
        """
        x = cast_factor(x)
        ctx.stride = stride
        ctx.save_for_backward(x, kernel)
        weight, bias = _conv2d_weight(kernel).to(x.dtype), bias.to(x.dtype)
        out = torch.conv2d(_to_image(x), weight, bias, *_stride_and_padding(kernel, stride))
        return _from_image(out, x)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        """Compute the gradients of all three tensors."""
        x, kernel = ctx.saved_tensors
        gradient = gradients[0].contiguous()
        d_kernel, stride = torch.zeros_like(kernel), ctx.stride
        half = kernel.shape[1] // 2
        for index, shift in enumerate(range(-half, half + 1)):
            # Output frames whose input frame at this shift exists.
            first = max(0, -(shift // stride))
            last = min(len(gradient), (len(x) - 1 - shift) // stride + 1)
            if first < last:
                inputs = x[first * stride + shift :: stride][: last - first]
                d_kernel[:, index] = weight_gradient(gradient[first:last], inputs)
        d_x = None
        if ctx.needs_input_grad[0]:
            weight, only_input = _conv2d_weight(kernel).to(x.dtype), (True, False, False)
            geometry = *_stride_and_padding(kernel, stride), (1, 1), False, (0, 0), 1
            image = torch.ops.aten.convolution_backward(
                _to_image(gradient), _to_image(x), weight, None, *geometry, only_input
            )[0]
            d_x = _from_image(image, x)
        return d_x, d_kernel, to_float32(flatten_rows(gradient).sum(dim=0)), None


def _to_image(x: Tensor) -> Tensor:
    """View frames as an image (1, C, T, J B), channels last in memory."""
    return x.view(1, len(x), -1, x.shape[-1]).permute(0, 3, 1, 2)


def _from_image(image: Tensor, like: Tensor) -> Tensor:
    return image.permute(0, 2, 3, 1).reshape(-1, *like.shape[1:-1], image.shape[1])


def _conv2d_weight(kernel: Tensor) -> Tensor:
    return kernel.transpose(1, 2)[..., None].contiguous()


def _stride_and_padding(kernel: Tensor, stride: int) -> tuple[tuple[int, int], tuple[int, int]]:
    return (stride, 1), (kernel.shape[1] // 2, 0)


def _flatten_frames(x: Tensor) -> Tensor:
    return x.view(*x.shape[:2], -1)


def _expand_adjacency(adjacency: Tensor, x: Tensor) -> Tensor:
    return adjacency.to(x.dtype).expand(len(x), *adjacency.shape)


def _multiply_adjacency(adjacency: Tensor, x: Tensor) -> Tensor:
    """Compute ``A X`` of each frame."""
    return torch.bmm(_expand_adjacency(adjacency, x), _flatten_frames(x)).view_as(x)


def _add_multiplied(out: Tensor, adjacency: Tensor, x: Tensor) -> None:
    """Add ``A X`` of each frame in place."""
    if x.dtype == torch.bfloat16:
        out += _multiply_adjacency(adjacency, x)
    else:
        _flatten_frames(out).baddbmm_(_expand_adjacency(adjacency, x), _flatten_frames(x))


def _adjacency_gradient(left: Tensor, right: Tensor) -> Tensor:
    """Sum ``(J, N) (J, N)^T`` over frames."""
    return to_float32(torch.bmm(_flatten_frames(left), _flatten_frames(right).mT)).sum(dim=0)


class GraphGruFunction(torch.autograd.Function):
    """All steps of a ``GraphGru``; the backward pass is one loop over frames.

    The intermediate tensors of a frame are computed, used and summed while they are in the
    processor's cache; reading tensors of all frames from memory takes longer than the products.
    """

    @staticmethod
    def forward(  # noqa: PLR0913  # autograd passes tensors one by one
        ctx: Any,
        x: Tensor,
        initial_state: Tensor,
        adjacency: Tensor,
        message_weight: Tensor,
        input_weight: Tensor,
        input_bias: Tensor,
        needs_gradients: bool,
    ) -> Tensor:
        """Compute states ``(T, J, B, h)`` of inputs ``(T, J, B, C)`` from a state ``(J, B, h)``.

        Parameters
        ----------
        adjacency, message_weight : (J, J) and (h, 3h), of ``GraphGru.folded_weights``
        input_weight, input_bias : (3h, C) and (3h,), of reset gate, update gate and candidate
        needs_gradients : whether to store each frame's gates for the backward pass
        """
        x = cast_factor(x)
        n_frames, n_joints, n_rows, hidden = len(x), *initial_state.shape
        states = initial_state.new_empty(n_frames + 1, n_joints, n_rows, hidden)
        states[0] = initial_state
        mixed = torch.empty_like(initial_state)
        parts = torch.split(message_weight.T, [2 * hidden, hidden])
        to_gates, to_candidate = (part.contiguous() for part in parts)
        # Per frame: reset, update and candidate; and the candidate's part of the message.
        all_activations, all_messages = [], []
        for frame in range(n_frames):
            state = states[frame]
            torch.mm(adjacency, state.flatten(1), out=mixed.flatten(1))
            message = mixed.to(x.dtype)
            activations = linear(x[frame], input_weight, input_bias)
            candidate_message = linear(message, to_candidate)
            gates, candidate = activations[..., : 2 * hidden], activations[..., 2 * hidden :]
            add_linear(gates, message, to_gates)
            gates.sigmoid_()
            candidate.addcmul_(gates[..., :hidden], candidate_message)
            # tanh x = 2 sigmoid(2 x) - 1: torch's tanh takes six times as long.
            candidate.mul_(2).sigmoid_().mul_(2).sub_(1)
            torch.lerp(candidate, state, gates[..., hidden:], out=states[frame + 1])
            if needs_gradients:
                all_activations.append(activations)
                all_messages.append(candidate_message)
        saved = x, adjacency, message_weight, input_weight, states
        ctx.save_for_backward(*saved, *all_activations, *all_messages)
        return states[1:]

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        """Compute the gradients of all six tensors."""
        x, adjacency, message_weight, input_weight, states, *per_frame = ctx.saved_tensors
        all_activations, all_messages = per_frame[: len(x)], per_frame[len(x) :]
        gradient, hidden = gradients[0].contiguous(), states.shape[-1]
        d_x, d_state = torch.empty_like(x), torch.zeros_like(states[0])
        weights = adjacency, message_weight, input_weight, input_weight[:, 0]
        d_adjacency, d_message_weight, d_input_weight, d_bias = (
            torch.zeros_like(each) for each in weights
        )
        # Of the input's and the message's part of the activations before the nonlinearity; they
        # differ for the candidate only.
        d_input, d_message, mixed = (
            torch.empty_like(each) for each in (per_frame[0], per_frame[0], d_state)
        )
        for frame in reversed(range(len(gradient))):
            state, activations, message = states[frame], all_activations[frame], all_messages[frame]
            gates, candidate = activations[..., : 2 * hidden], activations[..., 2 * hidden :]
            reset, update = gates[..., :hidden], gates[..., hidden:]
            total = d_state.add_(gradient[frame])
            d_tanh = torch.addcmul(total, total, update, value=-1)
            d_candidate = torch.ops.aten.tanh_backward(d_tanh, candidate)
            torch.mul(d_candidate, message, out=d_input[..., :hidden])
            torch.mul(total, state - candidate, out=d_input[..., hidden : 2 * hidden])
            d_gates = d_input[..., : 2 * hidden]
            torch.ops.aten.sigmoid_backward.grad_input(d_gates, gates, grad_input=d_gates)
            d_message[..., : 2 * hidden] = d_gates
            torch.mul(d_candidate, reset, out=d_message[..., 2 * hidden :])
            d_input[..., 2 * hidden :] = d_candidate
            input_factor, message_factor = d_input.to(x.dtype), d_message.to(x.dtype)
            d_x[frame] = linear(input_factor, input_weight.T)
            d_input_weight += weight_gradient(input_factor, x[frame])
            d_bias += d_input.sum(dim=(0, 1))
            torch.mm(adjacency, state.flatten(1), out=mixed.flatten(1))
            d_message_weight += weight_gradient(mixed, message_factor)
            d_mixed = linear(message_factor, message_weight).flatten(1)
            d_adjacency.addmm_(d_mixed, state.flatten(1).T)
            d_state.mul_(update).flatten(1).addmm_(adjacency.T, d_mixed)
        return d_x, d_state, d_adjacency, d_message_weight, d_input_weight, d_bias, None
