"""What networks take in: normalised motions, time, duration and the embedding of an action."""

import math
from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional

from pacmo_core.reaction.data import MotionPairs

# Durations that hardly vary would otherwise be blown up to unit variance.
MIN_DURATION_STD = 0.1


class Normalisation(nn.Module):
    """Centre each channel; divide by one scale, so that all joints keep their metric.

    Parameters
    ----------
    channels : 3 J
    """

    partner_mean: Tensor
    reaction_mean: Tensor
    scale: Tensor
    log_duration: Tensor

    def __init__(self, *, channels: int) -> None:
        super().__init__()
        self.register_buffer("partner_mean", torch.zeros(channels))
        self.register_buffer("reaction_mean", torch.zeros(channels))
        self.register_buffer("scale", torch.ones(()))
        self.register_buffer("log_duration", torch.tensor([0.0, 1.0]))

    def measure(self, pairs: MotionPairs) -> None:
        """Take means and scales from real training data."""
        partner_mean = pairs.partner.mean(dim=(0, 1))
        reaction_mean = pairs.reaction.mean(dim=(0, 1))
        both = torch.cat([pairs.partner - partner_mean, pairs.reaction - reaction_mean])
        spread = pairs.log_duration.std(correction=0).clamp(min=MIN_DURATION_STD)
        self.partner_mean.copy_(partner_mean)
        self.reaction_mean.copy_(reaction_mean)
        self.scale.copy_(both.square().mean().sqrt())
        self.log_duration.copy_(torch.stack([pairs.log_duration.mean(), spread]))

    def partner(self, metres: Tensor) -> Tensor:
        """Normalise a partner's motion, channels last."""
        return (metres - self.partner_mean) / self.scale

    def reaction(self, metres: Tensor) -> Tensor:
        """Normalise a reaction."""
        return (metres - self.reaction_mean) / self.scale

    def metres(self, reaction: Tensor) -> Tensor:
        """Undo ``reaction``."""
        return reaction * self.scale + self.reaction_mean

    def partner_metres(self, partner: Tensor) -> Tensor:
        """Undo ``partner``."""
        return partner * self.scale + self.partner_mean

    def context(self, times: Tensor, log_duration: Tensor, period: float) -> Tensor:
        """``(B, T, 3)``: sine and cosine of time over one period, and the normalised log-duration.

        Periodic functions rather than a ramp, whose jump would ring through the Fourier layers.
        """
        mean, spread = self.log_duration
        angle = 2 * math.pi / period * times
        clock = torch.stack([angle.sin(), angle.cos()], dim=-1).float()
        duration = ((log_duration - mean) / spread)[:, None, None].expand(-1, len(times), 1)
        return torch.cat([clock.expand(len(log_duration), -1, -1), duration], dim=-1)


class ActionEmbedding(nn.Module):
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


def action_indices(labels: Sequence[str], known: Sequence[str]) -> Tensor:
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
