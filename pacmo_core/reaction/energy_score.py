"""The energy score, a strictly proper score of samples against an observation.

``ES(P, u) = E |X - u| - E |X - X'| / 2`` for samples X, X' of P (Gneiting and Raftery 2007,
*Strictly proper scoring rules, prediction, and estimation*, eq. 22, negated): its mean is lowest
when u is distributed as P. So a generator may be trained on it and weights selected by it. It
depends on the partner, of whose reactions u is one.

A critic learns to separate generated from real motion, but from a few hundred interactions it
learns little about which reaction belongs to which partner. The score depends on that from the
first step and, having no opponent, does not oscillate.
"""

import torch
from torch import Tensor

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.operators.quadrature import trapezoid_weights
from pacmo_core.reaction.data import MotionPairs
from pacmo_core.reaction.generator import Generator

# Factors that bring the views of a motion to similar magnitudes.
BONE_SCALE, SPEED_SCALE = 2.0, 0.25


class EnergyScore:
    """The mean of the energy scores of several linear views of a motion.

    The distance of whole motions depends little on the pose, so four more views are scored: the
    root's path, the pose relative to the root, the bones, and the velocity. The score of each view
    is proper, that of the whole motion strictly proper.

    Parameters
    ----------
    skeleton : Skeleton
    """

    def __init__(self, skeleton: Skeleton) -> None:
        self.root = skeleton.root
        self.parents, self.children = torch.from_numpy(skeleton.bones).long().unbind(-1)

    def __call__(
        self, samples: Tensor, ground_truth: Tensor, weights: Tensor, spread: float = 1.0
    ) -> Tensor:
        """Score normalised motions; lower is better.

        Parameters
        ----------
        samples : (K, B, T, 3 J), K at least 2 for each partner, T evenly spaced times
        ground_truth : (B, T, 3 J)
        weights : (T,), of the quadrature on [0, 1]
        spread : factor of the spread term; 1 is the proper score, less favours less diversity

        Returns
        -------
        (B,)
        """
        views = zip(self._views(samples), self._views(ground_truth), strict=True)
        return torch.stack([energy_score(*view, weights, spread) for view in views]).mean(dim=0)

    def _views(self, motion: Tensor) -> list[Tensor]:
        joints = motion.view(*motion.shape[:-1], -1, 3)
        path = joints[..., self.root, :]
        pose = (joints - path[..., None, :]).flatten(-2)
        bones = (joints[..., self.children, :] - joints[..., self.parents, :]).flatten(-2)
        step = 1 / (motion.shape[-2] - 1)
        (velocity,) = torch.gradient(motion, spacing=step, dim=-2)
        return [motion, path, pose, BONE_SCALE * bones, SPEED_SCALE * velocity]


def energy_score(
    samples: Tensor, ground_truth: Tensor, weights: Tensor, spread: float = 1.0
) -> Tensor:
    """Return ``E |X - u| - spread E |X - X'| / 2``, unbiased, in the norm of L2 over time.

    Parameters
    ----------
    samples : (K, B, T, C), K at least 2
    ground_truth : (B, T, C)
    weights : (T,), of the quadrature
    spread : 1 for the proper score

    Returns
    -------
    (B,), in units of a channel's root mean square

    Raises
    ------
    ValueError
        If there are fewer than two samples.
    """
    n_samples = len(samples)
    if n_samples < 2:
        raise ValueError(f"an energy score needs at least 2 samples; got {n_samples}")
    error = _l2_norm(samples - ground_truth, weights).mean(dim=0)
    # Every pair once: for each lag k the pairs k apart.
    lags = range(1, n_samples)
    distances = [_l2_norm(samples[k:] - samples[:-k], weights).sum(dim=0) for k in lags]
    return error - spread * torch.stack(distances).sum(dim=0) / (n_samples * (n_samples - 1))


@torch.no_grad()
def mean_energy_score(
    model: Generator,
    pairs: MotionPairs,
    *,
    n_samples: int,
    batch_size: int,
    random: torch.Generator,
) -> Tensor:
    """Return the mean score of a generator's reactions to the partners of real pairs: ``()``."""
    weights, score = trapezoid_weights(model.points), EnergyScore(model.skeleton)
    scores = []
    for rows in torch.split(torch.arange(len(pairs), device=pairs.partner.device), batch_size):
        batch = pairs[rows]
        noise = model.sample_noise(n_samples * len(batch), random).to(rows.device)
        samples = sample_reactions(model, noise, batch)
        ground_truth = model.normalisation.normalise_reaction(batch.reaction)
        scores.append(score(samples, ground_truth, weights))
    return torch.cat(scores).mean()


def sample_reactions(model: Generator, noise: Tensor, pairs: MotionPairs) -> Tensor:
    """Generate S normalised reactions to each of B partners.

    Parameters
    ----------
    model : Generator
    noise : (S B, k, 2 K)
    pairs : B of them

    Returns
    -------
    (S, B, N, 3 J)
    """
    n_samples = len(noise) // len(pairs)
    repeated = pairs.repeat(n_samples)
    reactions = model.normalisation.normalise_reaction(model(noise, repeated.condition))
    return reactions.view(n_samples, *pairs.reaction.shape)


def _l2_norm(motion: Tensor, weights: Tensor) -> Tensor:
    """``(..., T, C)`` to ``(...)``."""
    # The constant keeps the square root differentiable where motions are equal.
    norm: Tensor = (motion.square().mean(dim=-1) @ weights + 1e-8).sqrt()
    return norm
