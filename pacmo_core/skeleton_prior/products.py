"""Products of matrices along joints and along time, with gradients that copy nothing.

What autograd would do of itself is the same arithmetic; but it would gather a frame's neighbours
side by side, forwards and backwards, and to fetch the memory for that costs more than to multiply.
"""

from typing import Any

import torch
from torch import Tensor


def over_joints(links: Tensor, x: Tensor) -> Tensor:
    """``links X``, of (J, J) and (..., J, C) of few channels.

    One product of all frames: as a product a frame, of so few channels, it takes six times as long.
    """
    return (x.mT.contiguous() @ links.T).mT


def flat(x: Tensor) -> Tensor:
    """``(..., C)`` to the rows of one matrix, (N, C), where they lie."""
    return x.view(-1, x.shape[-1])


class Mixing(torch.autograd.Function):
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
        x = x.contiguous()
        out = x.new_empty(*x.shape[:-1], len(along))
        torch.addmm(bias, flat(x), own.T, out=flat(out))
        # The narrower side is mixed over joints: mixing commutes with the weights.
        inside = along.shape[1] <= along.shape[0]
        if inside:
            mixed = _mixed(links, x)
            flat(out).addmm_(flat(mixed), along.T)
        else:
            mixed = (flat(x) @ along.T).view_as(out)
            _frames(out).baddbmm_(_each(links, len(x)), _frames(mixed))
        ctx.inside = inside
        ctx.save_for_backward(x, mixed, links, along, own)
        return out

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        """Give the gradients of all five."""
        x, mixed, links, along, own = ctx.saved_tensors
        gradient = gradients[0].contiguous()
        rows, wanted = flat(gradient), ctx.needs_input_grad[0]
        if ctx.inside:
            through = (rows @ along).view_as(x)
            d_links = _outer(through, x)
            d_along = rows.T @ flat(mixed)
            back = _mixed(links.T, through) if wanted else None
        else:
            d_links = _outer(gradient, mixed)
            through = _mixed(links.T, gradient)
            d_along = flat(through).T @ flat(x)
            back = (flat(through) @ along).view_as(x) if wanted else None
        if back is not None:
            flat(back).addmm_(rows, own)
        return back, d_links, d_along, rows.T @ flat(x), rows.sum(dim=0)


class Sliding(torch.autograd.Function):
    """A convolution over time, the first axis, centred; what is beyond the ends is zero.

    torch's own, but for the weights' gradient: as a product a frame of the kernel it takes half the
    time.
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
        x = x.contiguous()
        ctx.stride = stride
        ctx.save_for_backward(x, kernel)
        out = torch.conv2d(_image(x), _taps(kernel), bias, *_geometry(kernel, stride))
        return _from_image(out, x)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        """Give the gradients of all three."""
        x, kernel = ctx.saved_tensors
        gradient = gradients[0].contiguous()
        d_kernel = torch.zeros_like(kernel)
        for tap, shift in enumerate(range(-(kernel.shape[1] // 2), kernel.shape[1] // 2 + 1)):
            # Frames out whose frame in, so far away, is there.
            first = max(0, -(shift // ctx.stride))
            last = min(len(gradient), (len(x) - 1 - shift) // ctx.stride + 1)
            if first < last:
                seen = x[first * ctx.stride + shift :: ctx.stride][: last - first]
                d_kernel[:, tap] = flat(gradient[first:last]).T @ seen.reshape(-1, x.shape[-1])
        back = None
        if ctx.needs_input_grad[0]:
            stride, padding = _geometry(kernel, ctx.stride)
            args = (_image(gradient), _image(x), _taps(kernel), None, stride, padding)
            only = (True, False, False)
            image = torch.ops.aten.convolution_backward(*args, (1, 1), False, (0, 0), 1, only)[0]
            back = _from_image(image, x)
        return back, d_kernel, flat(gradient).sum(dim=0), None


def _image(x: Tensor) -> Tensor:
    """As high as time and as wide as joints and rows; in memory channels stay last."""
    return x.view(1, len(x), -1, x.shape[-1]).permute(0, 3, 1, 2)


def _from_image(image: Tensor, like: Tensor) -> Tensor:
    return image.permute(0, 2, 3, 1).reshape(-1, *like.shape[1:-1], image.shape[1])


def _taps(kernel: Tensor) -> Tensor:
    return kernel.transpose(1, 2)[..., None].contiguous()


def _geometry(kernel: Tensor, stride: int) -> tuple[tuple[int, int], tuple[int, int]]:
    return (stride, 1), (kernel.shape[1] // 2, 0)


def _frames(x: Tensor) -> Tensor:
    return x.view(*x.shape[:2], -1)


def _each(matrix: Tensor, n: int) -> Tensor:
    return matrix.expand(n, *matrix.shape)


def _mixed(links: Tensor, x: Tensor) -> Tensor:
    return torch.bmm(_each(links, len(x)), _frames(x)).view_as(x)


def _outer(left: Tensor, right: Tensor) -> Tensor:
    """Sum over all frames of ``(J, N) (J, N)ᵀ``."""
    return torch.bmm(_frames(left), _frames(right).mT).sum(dim=0)
