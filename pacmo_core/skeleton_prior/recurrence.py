"""The graph gated recurrent unit: over a sequence that is all known, or step by step."""

from typing import Any

import torch
from torch import Tensor, nn

from pacmo_core.skeleton_prior.products import add_dense, dense, factor, outer


class GraphGru(nn.Module):
    """The graph gated recurrent unit over whole sequences.

    With the message ``M = A H W``::

        r  = s(r_in(x) + r_hid(M))
        u  = s(u_in(x) + u_hid(M))
        c  = tanh(c_in(x) + r * c_hid(M))
        H' = u * H + (1 - u) * c

    Unlike the supplement's equation 2, the gates' sums stand inside the sigmoid, without which
    they are no gates, and all products are elementwise. One message serves all gates.

    Parameters
    ----------
    adjacency : (J, J), each joint with itself among them
    in_channels, hidden : int
    """

    adjacency: Tensor

    def __init__(self, adjacency: Tensor, in_channels: int, hidden: int) -> None:
        super().__init__()
        self.register_buffer("adjacency", adjacency)
        self.hidden = hidden
        self.mask = nn.Parameter(torch.ones_like(adjacency))
        self.added = nn.Parameter(torch.zeros_like(adjacency))
        self.message = nn.Linear(hidden, hidden, bias=False)
        self.gates_in = nn.Linear(in_channels, 3 * hidden)  # reset, update, candidate
        self.gates_hidden = nn.Linear(hidden, 3 * hidden, bias=False)

    def weights(self) -> tuple[Tensor, Tensor]:
        """Fold what is constant over a sequence: links (J, J), message with gates (h, 3h)."""
        folded = self.message.weight.T @ self.gates_hidden.weight.T
        return self.adjacency * self.mask + self.added, folded

    def step(self, weights: tuple[Tensor, Tensor], given: Tensor, state: Tensor) -> Tensor:
        """Go one frame on, joints first, so that both products are of two plain matrices.

        Parameters
        ----------
        weights : as ``weights`` folds them
        given : (J, B, 3h), the input through ``gates_in``
        state : (J, B, h)
        """
        links, folded = weights
        n_joints, n_rows, hidden = state.shape
        mixed = links @ state.reshape(n_joints, -1)
        gates = (mixed.view(-1, hidden) @ folded).view(n_joints, n_rows, 3 * hidden)
        both = torch.sigmoid(given[..., : 2 * hidden] + gates[..., : 2 * hidden])
        reset, update = both[..., :hidden], both[..., hidden:]
        candidate = torch.tanh(
            torch.addcmul(given[..., 2 * hidden :], reset, gates[..., 2 * hidden :])
        )
        return torch.lerp(candidate, state, update)

    def forward(self, x: Tensor, state: Tensor) -> Tensor:
        """Run over an input that is all known: its projections are one product over all time.

        Parameters
        ----------
        x : (T, J, B, C)
        state : (J, B, h), before the first frame

        Returns
        -------
        (T, J, B, h), the states after each frame
        """
        links, folded = self.weights()
        into = self.gates_in
        keeps = torch.is_grad_enabled()  # which a Function is not told
        states: Tensor = Running.apply(x, state, links, folded, into.weight, into.bias, keeps)  # type: ignore[no-untyped-call]  # torch leaves it untyped
        return states


class Running(torch.autograd.Function):
    """All steps of a ``GraphGru``, and their gradients in one loop backwards.

    What a frame needs is made, used and summed up while it is in the processor's cache: to fetch
    tensors of all frames from memory, one for each gate, would take longer than to multiply them.
    """

    @staticmethod
    def forward(  # noqa: PLR0913  # autograd wants its tensors one by one
        ctx: Any,
        x: Tensor,
        start: Tensor,
        links: Tensor,
        folded: Tensor,
        told: Tensor,
        bias: Tensor,
        keeps: bool,
    ) -> Tensor:
        """Run from a state: ``(T, J, B, C)`` and ``(J, B, h)`` to states ``(T, J, B, h)``.

        Parameters
        ----------
        links, folded : as ``GraphGru.weights`` has them
        told, bias : (3h, C) and (3h,), of what comes in
        keeps : whether to keep of each frame what gradients need
        """
        x = factor(x)
        n_frames, n_joints, n_rows, hidden = len(x), *start.shape
        states = start.new_empty(n_frames + 1, n_joints, n_rows, hidden)
        states[0] = start
        mixed = torch.empty_like(start)
        parts = torch.split(folded.T, [2 * hidden, hidden])
        to_gates, to_candidate = (part.contiguous() for part in parts)
        # Of each frame: reset, update and candidate; what the candidate hears through the reset.
        all_opened, all_heard = [], []
        for frame in range(n_frames):
            state = states[frame]
            torch.mm(links, state.flatten(1), out=mixed.flatten(1))
            message = mixed.to(x.dtype)
            opened, heard = dense(x[frame], told, bias), dense(message, to_candidate)
            both, candidate = opened[..., : 2 * hidden], opened[..., 2 * hidden :]
            add_dense(both, message, to_gates)
            both.sigmoid_()
            candidate.addcmul_(both[..., :hidden], heard)
            # tanh x = 2 s(2x) - 1: torch's own takes six times as long.
            candidate.mul_(2).sigmoid_().mul_(2).sub_(1)
            torch.lerp(candidate, state, both[..., hidden:], out=states[frame + 1])
            if keeps:
                all_opened.append(opened)
                all_heard.append(heard)
        ctx.save_for_backward(x, links, folded, told, states, *all_opened, *all_heard)
        return states[1:]

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        """Give the gradients of all six tensors."""
        x, links, folded, told, states, *kept = ctx.saved_tensors
        all_opened, all_heard = kept[: len(x)], kept[len(x) :]
        gradient, hidden = gradients[0].contiguous(), states.shape[-1]
        d_x, carried = torch.empty_like(x), torch.zeros_like(states[0])
        weights = links, folded, told, told[:, 0]
        d_links, d_folded, d_told, d_bias = (torch.zeros_like(each) for each in weights)
        # Of what comes in, and of what is heard: but for the candidate's part the same.
        d_in, d_heard, mixed = (torch.empty_like(each) for each in (kept[0], kept[0], carried))
        for frame in reversed(range(len(gradient))):
            state, opened, heard = states[frame], all_opened[frame], all_heard[frame]
            both, candidate = opened[..., : 2 * hidden], opened[..., 2 * hidden :]
            reset, update = both[..., :hidden], both[..., hidden:]
            total = carried.add_(gradient[frame])
            through = torch.addcmul(total, total, update, value=-1)
            d_candidate = torch.ops.aten.tanh_backward(through, candidate)
            torch.mul(d_candidate, heard, out=d_in[..., :hidden])
            torch.mul(total, state - candidate, out=d_in[..., hidden : 2 * hidden])
            d_both = d_in[..., : 2 * hidden]
            torch.ops.aten.sigmoid_backward.grad_input(d_both, both, grad_input=d_both)
            d_heard[..., : 2 * hidden] = d_both
            torch.mul(d_candidate, reset, out=d_heard[..., 2 * hidden :])
            d_in[..., 2 * hidden :] = d_candidate
            in_factor, heard_factor = d_in.to(x.dtype), d_heard.to(x.dtype)
            d_x[frame] = dense(in_factor, told.T)
            d_told += outer(in_factor, x[frame])
            d_bias += d_in.sum(dim=(0, 1))
            torch.mm(links, state.flatten(1), out=mixed.flatten(1))
            d_folded += outer(mixed, heard_factor)
            d_mixed = dense(heard_factor, folded).flatten(1)
            d_links.addmm_(d_mixed, state.flatten(1).T)
            carried.mul_(update).flatten(1).addmm_(links.T, d_mixed)
        return d_x, carried, d_links, d_folded, d_told, d_bias, None
