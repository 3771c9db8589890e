"""A learned functional: a function of time to a real number."""

import torch
from torch import Tensor, nn

from pacmo_core.operators.quadrature import trapezoid_weights


class FunctionalLayer(nn.Module):
    """``r = integral kappa(t) v(t) dt``, kappa a small network of time (PaCMO, 3.2).

    Parameters
    ----------
    hidden : units of each of the two hidden layers of kappa
    """

    def __init__(self, *, hidden: int) -> None:
        super().__init__()
        self.kernel = nn.Sequential(
            nn.Linear(1, hidden),
            nn.GELU(),
            nn.Linear(hidden, hidden),
            nn.GELU(),
            nn.Linear(hidden, 1, bias=False),
        )

    def forward(self, v: Tensor, times: Tensor) -> Tensor:
        """Integrate ``(B, T)`` values at ``(T,)`` instants: ``(B,)``."""
        # An integral is a long sum: in single precision, whatever the networks around it run in.
        with torch.autocast(v.device.type, enabled=False):
            kappa: Tensor = self.kernel(times[:, None])[:, 0]
            return torch.mv(v.to(kappa.dtype), trapezoid_weights(times) * kappa)
