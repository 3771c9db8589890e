"""The energy score: how well draws of a law foretell what really happened.

``ES = E |X - u| - E |X - X'| / 2`` for draws X, X' of a law and the outcome u is least in the mean
when u is drawn from that very law (a proper score; Gneiting and Raftery 2007, section 4.2), so a
generator may be trained on it and weights be chosen by it. It sees the partner, for u answers it.

A critic learns to tell generated motion from real, but of a few hundred interactions it learns
little about which reaction belongs to which partner. The score says so from the first step, and,
having no opponent, does not oscillate.
"""

import torch
from torch import Tensor

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.operators.quadrature import trapezoid_weights
from pacmo_core.reaction.data import MotionPairs
from pacmo_core.reaction.generator import Generator

BONE_SCALE, SPEED_SCALE = 2.0, 0.25  # bring the views to like sizes; a score grows in proportion


class EnergyScore:
    """The mean of the energy scores of several linear views of a motion.

    The distance of whole motions hardly sees how a body is held, so more is scored than that: the
    root's path, the pose about the root, the bones, and the speed. The score of each view is
    proper, and that of the whole motion strictly so.

    Parameters
    ----------
    skeleton : Skeleton
    """

    def __init__(self, skeleton: Skeleton) -> None:
        self.root = skeleton.root
        self.parents, self.children = torch.from_numpy(skeleton.bones).long().unbind(-1)

    def __call__(
        self, samples: Tensor, truth: Tensor, weights: Tensor, spread: float = 1.0
    ) -> Tensor:
        """Score normalised motions, smaller is better.

        Parameters
        ----------
        samples : (K, B, T, 3 J), K at least 2 for each partner, T evenly spaced instants
        truth : (B, T, 3 J)
        weights : (T,), of the quadrature on [0, 1]
        spread : 1 is the proper score; less of it rewards draws that lie closer together

        Returns
        -------
        (B,)
        """
        views = zip(self._views(samples), self._views(truth), strict=True)
        return torch.stack([energy_score(*view, weights, spread) for view in views]).mean(dim=0)

    def _views(self, motion: Tensor) -> list[Tensor]:
        joints = motion.view(*motion.shape[:-1], -1, 3)
        path = joints[..., self.root, :]
        pose = (joints - path[..., None, :]).flatten(-2)
        bones = (joints[..., self.children, :] - joints[..., self.parents, :]).flatten(-2)
        step = 1 / (motion.shape[-2] - 1)
        (speed,) = torch.gradient(motion, spacing=step, dim=-2)
        return [motion, path, pose, BONE_SCALE * bones, SPEED_SCALE * speed]


def energy_score(samples: Tensor, truth: Tensor, weights: Tensor, spread: float = 1.0) -> Tensor:
    """Take ``E |X - u| - spread E |X - X'| / 2``, without bias, in a norm of L2 over time.

    Parameters
    ----------
    samples : (K, B, T, C), K at least 2
    truth : (B, T, C)
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
        raise ValueError(f"an energy score wants at least 2 samples; got {n_samples}")
    error = _l2_norm(samples - truth, weights).mean(dim=0)
    # Every pair once: those k apart, for each k.
    apart = [_l2_norm(samples[k:] - samples[:-k], weights).sum(dim=0) for k in range(1, n_samples)]
    return error - spread * torch.stack(apart).sum(dim=0) / (n_samples * (n_samples - 1))


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
    weights, of_motions = trapezoid_weights(model.points), EnergyScore(model.skeleton)
    scores = []
    for rows in torch.split(torch.arange(len(pairs), device=pairs.partner.device), batch_size):
        some = pairs[rows]
        noise = model.draw(n_samples * len(some), random).to(rows.device)
        samples = sample_reactions(model, noise, some)
        scores.append(of_motions(samples, model.normalisation.reaction(some.reaction), weights))
    return torch.cat(scores).mean()


def sample_reactions(model: Generator, noise: Tensor, pairs: MotionPairs) -> Tensor:
    """React S times to each of B partners, normalised.

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
    many = pairs.repeat(n_samples)
    made = model.normalisation.reaction(model(noise, many.condition))
    return made.view(n_samples, *pairs.reaction.shape)


def _l2_norm(motion: Tensor, weights: Tensor) -> Tensor:
    """``(..., T, C)`` to ``(...)``."""
    # The root of zero has no slope; equal motions are a ten-thousandth apart here.
    norm: Tensor = (motion.square().mean(dim=-1) @ weights + 1e-8).sqrt()
    return norm
