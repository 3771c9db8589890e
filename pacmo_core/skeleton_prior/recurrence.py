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

    Unlike autograd, which takes the gradient of the weights step by step, and those of seven
    products and sums in each, the slopes of all gates are taken at once before the loop, and the
    gradients of both weights as one product each after it.
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
        mixed, gates = torch.empty_like(states[1:]), torch.empty_like(given)
        # The reset and the update of each frame, and its candidate.
        opened, candidates = given[..., : 2 * hidden].clone(), torch.empty_like(mixed)
        for frame in range(n_frames):
            torch.mm(links, states[frame].flatten(1), out=mixed[frame].flatten(1))
            heard = gates[frame]
            torch.mm(mixed[frame].view(-1, hidden), folded, out=heard.view(-1, 3 * hidden))
            both = opened[frame].add_(heard[..., : 2 * hidden]).sigmoid_()
            candidate = torch.addcmul(
                given[frame, ..., 2 * hidden :],
                both[..., :hidden],
                heard[..., 2 * hidden :],
                out=candidates[frame],
            ).tanh_()
            torch.lerp(candidate, states[frame], both[..., hidden:], out=states[frame + 1])
        ctx.save_for_backward(links, folded, states, mixed, gates, opened, candidates)
        return states[1:]

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, ...]:
        """Give the gradients of all four."""
        links, folded, states, mixed, gates, opened, candidates = ctx.saved_tensors
        hidden = len(folded)
        reset, update = opened[..., :hidden], opened[..., hidden:]
        # What a state's gradient is to each gate, before its sigmoid or tanh.
        to_candidate = (1 - update) * (1 - candidates.square())
        to_update = (states[:-1] - candidates) * (update * (1 - update))
        to_reset = to_candidate * gates[..., 2 * hidden :] * (reset * (1 - reset))
        asked = torch.cat([to_reset, to_update, to_candidate * reset], dim=-1)
        totals, d_mixed = gradients[0].contiguous().clone(), torch.empty_like(mixed)
        carried = torch.zeros_like(totals[0])
        for frame in reversed(range(len(totals))):
            total = totals[frame].add_(carried)
            asked[frame].view(*total.shape[:2], 3, hidden).mul_(total[:, :, None])
            torch.mm(_rows(asked[frame]), folded.T, out=_rows(d_mixed[frame]))
            carried = torch.mm(links.T, d_mixed[frame].flatten(1)).view_as(total)
            carried.addcmul_(update[frame], total)
        d_folded = _rows(mixed).T @ _rows(asked)
        d_links = torch.bmm(d_mixed.flatten(2), states[:-1].flatten(2).mT).sum(dim=0)
        asked[..., 2 * hidden :] = to_candidate.mul_(totals)
        return asked, carried, d_links, d_folded


def _rows(x: Tensor) -> Tensor:
    return x.view(-1, x.shape[-1])
