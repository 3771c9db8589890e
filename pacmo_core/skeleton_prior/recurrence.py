"""The graph gated recurrent unit: over a sequence that is all known, or step by step."""

from typing import Any

import torch
from torch import Tensor, nn


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
        x : (B, T, J, C)
        state : (B, J, h), before the first frame

        Returns
        -------
        (B, T, J, h), the states after each frame
        """
        given = self.gates_in(x.permute(1, 2, 0, 3).contiguous())  # (T, J, B, 3h)
        start = state.transpose(0, 1).contiguous()
        states: Tensor = Running.apply(given, start, *self.weights())  # type: ignore[no-untyped-call]  # torch leaves it untyped
        return states.permute(2, 0, 1, 3)


class Running(torch.autograd.Function):
    """All steps of a ``GraphGru``, and their gradients in one loop backwards.

    Unlike autograd, which takes the gradients of the weights step by step, this takes both as one
    product each after the loop; within it, all but two products is of one frame, in the cache.
    """

    @staticmethod
    def forward(ctx: Any, given: Tensor, start: Tensor, links: Tensor, folded: Tensor) -> Tensor:
        """Run from a state: ``(T, J, B, 3h)`` and ``(J, B, h)`` to states ``(T, J, B, h)``.

        Parameters
        ----------
        links, folded : as ``GraphGru.weights`` has them
        """
        n_frames, n_joints, n_rows, hidden = len(given), *start.shape
        states = given.new_empty(n_frames + 1, n_joints, n_rows, hidden)
        states[0] = start
        mixed, heard, candidates = (torch.empty_like(states[1:]) for _ in range(3))
        # The reset and the update of each frame.
        opened = given.new_empty(n_frames, n_joints, n_rows, 2 * hidden)
        gates = torch.empty_like(given[0])
        for frame, told in enumerate(given):
            torch.mm(links, states[frame].flatten(1), out=mixed[frame].flatten(1))
            torch.mm(_rows(mixed[frame]), folded, out=_rows(gates))
            both = torch.add(told[..., : 2 * hidden], gates[..., : 2 * hidden], out=opened[frame])
            both.sigmoid_()
            heard[frame] = gates[..., 2 * hidden :]
            candidate = candidates[frame].copy_(told[..., 2 * hidden :])
            candidate.addcmul_(both[..., :hidden], heard[frame])
            # tanh x = 2 s(2x) - 1: torch's own takes six times as long.
            candidate.mul_(2).sigmoid_().mul_(2).sub_(1)
            torch.lerp(candidate, states[frame], both[..., hidden:], out=states[frame + 1])
        ctx.save_for_backward(links, folded, states, mixed, heard, opened, candidates)
        return states[1:]

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, ...]:
        """Give the gradients of all four."""
        links, folded, states, mixed, heard, opened, candidates = ctx.saved_tensors
        n_frames, n_joints, n_rows, hidden = mixed.shape
        d_mixed, d_candidates = torch.empty_like(mixed), torch.empty_like(mixed)
        # Of what is heard; what is given has the same, but for the candidate's part.
        d_gates = mixed.new_empty(n_frames, n_joints, n_rows, 3 * hidden)
        carried = torch.zeros_like(mixed[0])
        for frame in reversed(range(n_frames)):
            total = gradients[0][frame] + carried
            reset, update = opened[frame, ..., :hidden], opened[frame, ..., hidden:]
            candidate, gates = candidates[frame], d_gates[frame]
            through = torch.addcmul(total, total, update, value=-1)
            d_candidate = torch.ops.aten.tanh_backward(through, candidate)
            torch.mul(d_candidate, heard[frame], out=gates[..., :hidden])
            torch.mul(total, states[frame] - candidate, out=gates[..., hidden : 2 * hidden])
            both = gates[..., : 2 * hidden]
            torch.ops.aten.sigmoid_backward.grad_input(both, opened[frame], grad_input=both)
            torch.mul(d_candidate, reset, out=gates[..., 2 * hidden :])
            d_candidates[frame] = d_candidate
            torch.mm(_rows(gates), folded.T, out=_rows(d_mixed[frame]))
            carried = torch.mm(links.T, d_mixed[frame].flatten(1)).view_as(total)
            carried.addcmul_(update, total)
        d_folded = _rows(mixed).T @ _rows(d_gates)
        d_links = torch.bmm(d_mixed.flatten(2), states[:-1].flatten(2).mT).sum(dim=0)
        d_gates[..., 2 * hidden :] = d_candidates
        return d_gates, carried, d_links, d_folded


def _rows(x: Tensor) -> Tensor:
    return x.view(-1, x.shape[-1])
