"""Products of matrices along joints, with gradients that copy nothing.

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


class Mixing(torch.autograd.Function):
    """``links X W + X U + b`` over the joints, of the last two axes of a tensor."""

    @staticmethod
    def forward(
        ctx: Any, x: Tensor, links: Tensor, along: Tensor, own: Tensor, bias: Tensor
    ) -> Tensor:
        """``(..., J, C)`` to ``(..., J, D)``.

        Parameters
        ----------
        links : (J, J)
        along, own : (D, C)
        bias : (D,)
        """
        flat = x.reshape(-1, *x.shape[-2:]).contiguous()
        out = x.new_empty(*x.shape[:-1], len(along))
        torch.addmm(bias, _rows(flat), own.T, out=_rows(out))
        # The narrower side is mixed over joints: mixing commutes with the weights.
        inside = along.shape[1] <= along.shape[0]
        if inside:
            mixed = _over_joints(links, flat)
            _rows(out).addmm_(_rows(mixed), along.T)
        else:
            mixed = (_rows(flat) @ along.T).view(*flat.shape[:2], -1)
            out.view_as(mixed).baddbmm_(_each(links, len(mixed)), mixed)
        ctx.inside = inside
        ctx.save_for_backward(flat, mixed, links, along, own)
        return out

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        """Give the gradients of all five."""
        flat, mixed, links, along, own = ctx.saved_tensors
        shape = gradients[0].shape
        gradient = gradients[0].reshape(len(flat), shape[-2], -1).contiguous()
        rows = _rows(gradient)
        if ctx.inside:
            through = (rows @ along).view_as(flat)
            d_links = _outer(through, flat)
            d_along = rows.T @ _rows(mixed)
            back = _over_joints(links.T, through) if ctx.needs_input_grad[0] else None
        else:
            d_links = _outer(gradient, mixed)
            through = _over_joints(links.T, gradient)
            d_along = _rows(through).T @ _rows(flat)
            back = (_rows(through) @ along).view_as(flat) if ctx.needs_input_grad[0] else None
        if back is not None:
            _rows(back).addmm_(rows, own)
            back = back.view(*shape[:-1], -1)
        return back, d_links, d_along, rows.T @ _rows(flat), rows.sum(dim=0)


def _rows(x: Tensor) -> Tensor:
    return x.view(-1, x.shape[-1])


def _each(matrix: Tensor, n: int) -> Tensor:
    return matrix.expand(n, *matrix.shape)


def _over_joints(links: Tensor, x: Tensor) -> Tensor:
    return torch.bmm(_each(links, len(x)), x)


def _outer(rows: Tensor, columns: Tensor) -> Tensor:
    """Sum over all frames of ``(J, C) (J, C)ᵀ``."""
    return torch.bmm(rows, columns.mT).sum(dim=0)
