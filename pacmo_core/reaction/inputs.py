"""What networks take in: normalised motions, time, duration and the embedding of an action."""

import math
from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional

from pacmo_core.reaction.data import MotionPairs

# The label of an interaction whose action is not stated. A model that knows it wants no label.
UNLABELLED = ""
# Of the logarithm of duration: durations that hardly vary are not scaled to unit variance.
MIN_DURATION_STD = 0.1


class Normalisation(nn.Module):
    """Normalise motions: centre each channel, and divide all by one scale, in metres.

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
        self.register_buffer("log_duration", torch.tensor([0.0, 1.0]))  # mean, standard deviation

    def fit(self, pairs: MotionPairs) -> None:
        """Compute means and scales from training data."""
        partner_mean = pairs.partner.mean(dim=(0, 1))
        reaction_mean = pairs.reaction.mean(dim=(0, 1))
        both = torch.cat([pairs.partner - partner_mean, pairs.reaction - reaction_mean])
        deviation = pairs.log_duration.std(correction=0).clamp(min=MIN_DURATION_STD)
        self.partner_mean.copy_(partner_mean)
        self.reaction_mean.copy_(reaction_mean)
        self.scale.copy_(both.square().mean().sqrt())
        self.log_duration.copy_(torch.stack([pairs.log_duration.mean(), deviation]))

    def normalise_partner(self, metres: Tensor) -> Tensor:
        """Normalise a partner's motion, channels last."""
        return (metres - self.partner_mean) / self.scale

    def normalise_reaction(self, metres: Tensor) -> Tensor:
        """Normalise a reaction, channels last."""
        return (metres - self.reaction_mean) / self.scale

    def denormalise_reaction(self, reaction: Tensor) -> Tensor:
        """Return metres: the inverse of ``normalise_reaction``."""
        return reaction * self.scale + self.reaction_mean

    def denormalise_partner(self, partner: Tensor) -> Tensor:
        """Return metres: the inverse of ``normalise_partner``."""
        return partner * self.scale + self.partner_mean

    def time_and_duration(self, times: Tensor, log_duration: Tensor, period: float) -> Tensor:
        """``(B, T, 3)``: sine and cosine of time over a period, and the normalised log-duration.

        Periodic functions: the jump of a linear ramp would cause ringing in the Fourier layers.
        """
        mean, deviation = self.log_duration
        duration = ((log_duration - mean) / deviation)[:, None, None].expand(-1, len(times), 1)
        phase = _phase(times, period).expand(len(log_duration), -1, -1)
        return torch.cat([phase, duration], dim=-1)


class ActionEmbedding(nn.Module):
    """An action label as a function of time: the finite-dimensional condition (PaCMO, 3.2).

    ``c_s(y) = E(y (+) s)``, E a small network of a time y and a label s.

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
        """Evaluate ``(B,)`` labels at ``(T,)`` times in [0, 1]: ``(B, T, C)``."""
        label = functional.one_hot(action, self.n_actions).float()
        phase = _phase(times, period).expand(len(action), -1, -1)
        inputs = [phase, label[:, None].expand(-1, len(times), -1)]
        out: Tensor = self.network(torch.cat(inputs, dim=-1))
        return out


def action_indices(actions: Sequence[str], known: Sequence[str]) -> Tensor:
    """Return the index of each label in the list of known ones: ``(B,)``.

    Raises
    ------
    ValueError
        If one is not known.
    """
    unknown = sorted(set(actions) - set(known))
    if unknown:
        labels = [label for label in known if label]
        wanted = f"one of {', '.join(labels)}" if known else "empty: the model has no action labels"
        raise ValueError(f"action must be {wanted}; got {', '.join(map(repr, unknown))}")
    return torch.tensor([known.index(action) for action in actions], dtype=torch.long)


def _phase(times: Tensor, period: float) -> Tensor:
    """``(T, 2)``: sine and cosine of times."""
    angle = 2 * math.pi / period * times
    return torch.stack([angle.sin(), angle.cos()], dim=-1).float()
