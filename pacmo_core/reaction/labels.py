"""A label as a function of time: the finite-dimensional condition (PaCMO, 3.2)."""

import math
from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional


class LabelFunction(nn.Module):
    """``c_s(y) = E(y (+) s)``: a small network E of an instant y and an action label s.

    Parameters
    ----------
    n_actions : labels are numbers below it
    channels : of the function
    """

    def __init__(self, *, n_actions: int, channels: int) -> None:
        super().__init__()
        self.n_actions, self.channels = n_actions, channels
        self.network = nn.Sequential(
            nn.Linear(2 + n_actions, 4 * channels), nn.GELU(), nn.Linear(4 * channels, channels)
        )

    def forward(self, action: Tensor, times: Tensor, period: float) -> Tensor:
        """Evaluate ``(B,)`` labels at ``(T,)`` instants of [0, 1]: ``(B, T, C)``."""
        angle = 2 * math.pi / period * times
        # Periodic, as all else that the operators see of time.
        clock = torch.stack([angle.sin(), angle.cos()], dim=-1).float()
        label = functional.one_hot(action, self.n_actions).float()
        parts = [clock.expand(len(action), -1, -1), label[:, None].expand(-1, len(times), -1)]
        out: Tensor = self.network(torch.cat(parts, dim=-1))
        return out


def numbers_of(labels: Sequence[str], known: Sequence[str]) -> Tensor:
    """Find the numbers of labels by their place among those known: ``(B,)``.

    Raises
    ------
    ValueError
        If one is not known.
    """
    strange = sorted(set(labels) - set(known))
    if strange:
        wanted = f"one of {', '.join(known)}" if known else "none: the model knows no labels"
        raise ValueError(f"action must be {wanted}; got {', '.join(map(repr, strange))}")
    return torch.tensor([known.index(label) for label in labels], dtype=torch.long)
