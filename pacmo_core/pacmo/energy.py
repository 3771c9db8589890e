"""The energy score: how well samples foretell what happened, strictly proper (Gneiting 2007)."""

import torch
from torch import Tensor

from pacmo_core.operators.quadrature import trapezoid_weights
from pacmo_core.pacmo.functions import MotionPairs
from pacmo_core.pacmo.generator import Generator


def energy_score(samples: Tensor, truth: Tensor, weights: Tensor) -> Tensor:
    """Take ``E ||X - u|| - E ||X - X'|| / 2``, without bias, in the norm of L2 over time.

    Its expectation is least where the samples have the law of the truth, given the partner.

    Parameters
    ----------
    samples : (K, B, T, C), K at least 2
    truth : (B, T, C)
    weights : (T,), of the quadrature

    Returns
    -------
    (B,)

    Raises
    ------
    ValueError
        If there are fewer than two samples.
    """
    n_samples = len(samples)
    if n_samples < 2:
        raise ValueError(f"an energy score wants at least 2 samples; got {n_samples}")
    error = _norm(samples - truth, weights).mean(dim=0)
    # Every pair once: those k apart, for each k.
    apart = [_norm(samples[k:] - samples[:-k], weights).sum(dim=0) for k in range(1, n_samples)]
    return error - torch.stack(apart).sum(dim=0) / (n_samples * (n_samples - 1))


@torch.no_grad()
def mean_energy_score(
    model: Generator,
    pairs: MotionPairs,
    *,
    n_samples: int,
    batch_size: int,
    random: torch.Generator,
) -> Tensor:
    """Score a generator's reactions to the partners of real pairs, in normalised units: ``()``."""
    weights = trapezoid_weights(model.points)
    scores = []
    for rows in torch.split(torch.arange(len(pairs), device=pairs.partner.device), batch_size):
        some = pairs[rows]
        noise = model.draw(n_samples * len(some), random).to(rows.device)
        partner, duration = some.partner.repeat(n_samples, 1, 1), some.log_duration
        made = model(noise, partner, duration.repeat(n_samples))
        samples = model.normalisation.reaction(made).view(n_samples, *some.reaction.shape)
        scores.append(energy_score(samples, model.normalisation.reaction(some.reaction), weights))
    return torch.cat(scores).mean()


def _norm(motion: Tensor, weights: Tensor) -> Tensor:
    """``(..., T, C)`` to ``(...)``."""
    norm: Tensor = (motion.square().sum(dim=-1) @ weights).sqrt()
    return norm
