"""The energy score, a strictly proper score of samples against an observation.

``ES(P, u) = E |X - u| - E |X - X'| / 2`` for samples X, X' of P (Gneiting and Raftery 2007,
*Strictly proper scoring rules, prediction, and estimation*, eq. 22, negated): its mean is lowest
when u is distributed as P. So a generator may be trained on it and weights selected by it. It
depends on the partner, of whose reactions u is one.

A critic learns to separate generated from real motion, but from a few hundred interactions it
learns little about which reaction belongs to which partner. The score depends on that from the
first step and, having no opponent, does not oscillate.

The score of any function of motion and partner is proper too, though not strictly: if X is
distributed as u, then f(X) is distributed as f(u), which no other distribution scores better than
(Gneiting and Raftery 2007, section 2.1, on the class of distributions of f(u)). A sum of such
scores and a strictly proper one is strictly proper. ``ContactScore`` scores functions that see what
positions hardly show: whether the two people are in contact, and whether a foot stands.
"""

import torch
from torch import Tensor
from torch.nn import functional

from pacmo_core.data.segments import feet, trunk_pairs
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.operators.quadrature import trapezoid_weights
from pacmo_core.reaction.data import MotionPairs
from pacmo_core.reaction.generator import Generator
from pacmo_core.reaction.settings import ContactScoreSettings

# Metres. The first keeps the square root differentiable where joints coincide; the second bounds
# the logarithm there.
DISTANCE_SOFTENING, LOG_OFFSET = 0.02, 0.05

# Factors that bring the views of a motion to similar magnitudes.
BONE_SCALE, SPEED_SCALE, ACCELERATION_SCALE = 2.0, 0.25, 0.02
HEIGHT_SCALE, TRUNK_SCALE = 6.0, 3.0
INSTANT_WEIGHT = 0.1  # of each score at instants, relative to the mean of those of whole motions


class EnergyScore:
    """The mean of the energy scores of several linear views of a motion.

    The distance of whole motions depends little on the pose, so four more views are scored: the
    root's path, the pose relative to the root, the bones, and the velocity. A blow is a short
    motion of one hand or foot, which hardly counts in a distance over all joints: the places of
    hands, feet and head relative to the root, and their velocities, are scored each alone, and the
    scores averaged. The score of each view is proper, that of the whole motion strictly proper.

    In a norm over a whole motion the mean of many gaits, both feet gliding close together, or of
    turns to the left and to the right, a trunk without width, is hardly worse than one of them. At
    an instant it is far from all: a foot stands or swings, is ahead or behind, one hand or the
    other is up. So the velocities of both feet together, the places of both hands and of both feet,
    and the vectors from right to left foot, hip and shoulder are scored at each instant, and the
    scores averaged. So are the height of the root, the vectors along the trunk, and the
    accelerations of root, hips and shoulders: people walk metres and rise and sink by centimetres,
    so that in the other views a body that folds for a fifth of a second scores nearly as well as
    one that is upright.

    Parameters
    ----------
    skeleton : Skeleton
    """

    def __init__(self, skeleton: Skeleton) -> None:
        self.root, self.ends = skeleton.root, list(skeleton.end_effectors)
        self.parents, self.children = torch.from_numpy(skeleton.bones).long().unbind(-1)
        # Both ankles, and so on towards the toes.
        self.feet = [list(joints) for joints in zip(*feet(skeleton), strict=False)]
        self.end_pairs = [list(p) for p in skeleton.left_right if set(p) <= set(self.ends)]
        self.trunk_pairs = trunk_pairs(skeleton)

    def __call__(self, samples: Tensor, ground_truth: Tensor, weights: Tensor) -> Tensor:
        """Score normalised motions; lower is better.

        Parameters
        ----------
        samples : (K, B, T, 3 J), K at least 2 for each partner, T evenly spaced times
        ground_truth : (B, T, 3 J)
        weights : (T,), of the quadrature on [0, 1]

        Returns
        -------
        (B,)
        """
        views = zip(self.views(samples), self.views(ground_truth), strict=True)
        scores = [energy_score(*view, weights) for view in views]
        ends = zip(self._end_views(samples), self._end_views(ground_truth), strict=True)
        scores += [energy_score(*view, weights).mean(dim=-1) for view in ends]
        total = torch.stack(scores).mean(dim=0)
        instants = zip(self._instant_views(samples), self._instant_views(ground_truth), strict=True)
        one = torch.ones_like(weights[:1])
        for view in instants:
            total = total + INSTANT_WEIGHT * (energy_score(*view, one) @ weights)
        return total

    def views(self, motion: Tensor) -> list[Tensor]:
        """Return the linear views of ``(..., T, 3 J)`` on T evenly spaced times."""
        joints = motion.view(*motion.shape[:-1], -1, 3)
        path = joints[..., self.root, :]
        pose = (joints - path[..., None, :]).flatten(-2)
        bones = (joints[..., self.children, :] - joints[..., self.parents, :]).flatten(-2)
        step = 1 / (motion.shape[-2] - 1)
        (velocity,) = torch.gradient(motion, spacing=step, dim=-2)
        return [motion, path, pose, BONE_SCALE * bones, SPEED_SCALE * velocity]

    def _end_views(self, motion: Tensor) -> list[Tensor]:
        """Return places and velocities of the end effectors, ``(..., E, T, 3)`` each."""
        joints = motion.view(*motion.shape[:-1], -1, 3)
        places = (joints[..., self.ends, :] - joints[..., [self.root], :]).movedim(-2, -3)
        step = 1 / (motion.shape[-2] - 1)
        (velocity,) = torch.gradient(places, spacing=step, dim=-2)
        return [places, SPEED_SCALE * velocity]

    def _instant_views(self, motion: Tensor) -> list[Tensor]:
        """Return functions of each of the T times as motions of one time, ``(..., T, 1, C)``."""
        joints = motion.view(*motion.shape[:-1], -1, 3)
        step = 1 / (motion.shape[-2] - 1)
        (velocity,) = torch.gradient(joints, spacing=step, dim=-3)
        views = [SPEED_SCALE * velocity[..., pair, :].flatten(-2) for pair in self.feet]
        places = joints - joints[..., [self.root], :]
        views += [places[..., pair, :].flatten(-2) for pair in self.end_pairs]
        for pair in (*(joint for joint in self.feet if len(joint) > 1), *self.trunk_pairs):
            across = joints[..., list(pair[1:]), :] - joints[..., list(pair[:-1]), :]
            views.append(BONE_SCALE * across.flatten(-2))
        views += self._trunk_views(joints, step)
        return [view[..., None, :] for view in views]

    def _trunk_views(self, joints: Tensor, step: float) -> list[Tensor]:
        """Return the root's height, vectors along the trunk, accelerations: ``(..., T, C)``."""
        root = joints[..., self.root, :]
        trunk = [joints[..., pair, :].mean(dim=-2) for pair in self.trunk_pairs]
        views = [HEIGHT_SCALE * root[..., 1:2]]
        views += [TRUNK_SCALE * (middle - root) for middle in trunk]
        moving = torch.cat([root, *trunk], dim=-1)
        bend = moving[..., 2:, :] - 2 * moving[..., 1:-1, :] + moving[..., :-2, :]
        bend = functional.pad(bend, (0, 0, 1, 1))  # none at the ends
        return [*views, ACCELERATION_SCALE * bend / step**2]


class ContactScore:
    """Energy scores of distances between the two people, and of feet that stand.

    With the distances ``d_ij = sqrt(|x_i - y_j|^2 + (2 cm)^2)`` between joints of which one at
    least is an end effector, and the speeds v of the reaction's feet, the functions are

    - ``near``: ``exp(-d / near_distance)``, in the norm that sums over pairs: few are near;
    - ``log_distance``: ``log(d + 5 cm)``, in the norm that averages over pairs;
    - ``approach``: the logarithm of the least distance, over the whole motion, of each end effector
      of either person to the other's joints, in the norm that averages over end effectors: a blow
      is near for a tenth of a second, which hardly counts in a mean over time;
    - ``stance``: ``exp(-|v| / stance_speed)``, in the norm that averages over feet.

    Parameters
    ----------
    skeleton : of both people
    settings : ContactScoreSettings
    """

    def __init__(self, skeleton: Skeleton, settings: ContactScoreSettings) -> None:
        self.settings = settings
        self.ends = list(skeleton.end_effectors)
        self.inner = [j for j in range(len(skeleton.joints)) if j not in skeleton.end_effectors]
        self.feet = [joint for foot in feet(skeleton) for joint in foot]

    def __call__(
        self, samples: Tensor, real: MotionPairs, weights: Tensor, spread: float = 1.0
    ) -> dict[str, Tensor]:
        """Score reactions by each of the functions; lower is better.

        Parameters
        ----------
        samples : (K, B, T, 3 J) metres, in the frames of ``real``, K at least 2
        real : B pairs, on T evenly spaced times
        weights : (T,), of the quadrature on [0, 1]
        spread : as in ``energy_score``

        Returns
        -------
        (B,) by the name of the function; without feet there is no ``stance``
        """
        partner = _joints(real.partner)
        generated, captured = (
            self._views(_joints(motion), partner, real.log_duration)
            for motion in (samples, real.reaction)
        )
        whole = torch.ones_like(weights[:1])
        return {
            name: energy_score(
                generated[name], captured[name], whole if name == "approach" else weights, spread
            )
            for name in generated
        }

    def total(self, scores: dict[str, Tensor]) -> Tensor:
        """Return the sum of the scores, weighted by the settings."""
        total = sum(getattr(self.settings, f"{name}_weight") * scores[name] for name in scores)
        return torch.as_tensor(total)

    def _views(self, joints: Tensor, partner: Tensor, log_duration: Tensor) -> dict[str, Tensor]:
        # (..., T, E, J) and (..., T, J - E, E) metres.
        of_ends = _distances(joints[..., self.ends, :], partner)
        of_inner = _distances(joints[..., self.inner, :], partner[..., self.ends, :])
        distance = torch.cat([of_ends.flatten(-2), of_inner.flatten(-2)], dim=-1)
        near = (-distance / self.settings.near_distance).exp()
        of_partners_ends = torch.cat([of_ends[..., self.ends], of_inner], dim=-2)
        least = torch.cat([of_ends.amin((-3, -1)), of_partners_ends.amin((-3, -2))], dim=-1)
        # The norm averages over channels.
        views = {
            "near": distance.shape[-1] ** 0.5 * near,
            "log_distance": (distance + LOG_OFFSET).log(),
            "approach": (least + LOG_OFFSET).log()[..., None, :],  # as a motion of one time
        }
        if self.feet:
            step = 1 / (joints.shape[-3] - 1)
            (velocity,) = torch.gradient(joints[..., self.feet, :], spacing=step, dim=-3)
            # A millimetre a second at least: the norm is not differentiable at zero.
            speed = (velocity.square().sum(dim=-1) + 1e-6).sqrt() / log_duration.exp()[
                :, None, None
            ]
            views["stance"] = (-speed / self.settings.stance_speed).exp()
        return views


def _distances(first: Tensor, second: Tensor) -> Tensor:
    """From ``(..., I, 3)`` and ``(..., J, 3)`` to ``(..., I, J)``, softened."""
    axes = zip(first.unbind(-1), second.unbind(-1), strict=True)
    squares = [(x[..., :, None] - y[..., None, :]).square() for x, y in axes]
    return (squares[0] + squares[1] + squares[2] + DISTANCE_SOFTENING**2).sqrt()


def _joints(motion: Tensor) -> Tensor:
    return motion.view(*motion.shape[:-1], -1, 3)


def energy_score(
    samples: Tensor, ground_truth: Tensor, weights: Tensor, spread: float = 1.0
) -> Tensor:
    """Return ``E |X - u| - spread E |X - X'| / 2``, unbiased, in the norm of L2 over time.

    Parameters
    ----------
    samples : (K, B, ..., T, C), K at least 2
    ground_truth : (B, ..., T, C)
    weights : (T,), of the quadrature
    spread : 1 for the proper score; less favours less diversity

    Returns
    -------
    (B, ...), in units of a channel's root mean square

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
def mean_energy_scores(
    model: Generator,
    pairs: MotionPairs,
    contact_score: ContactScore,
    *,
    n_samples: int,
    batch_size: int,
    random: torch.Generator,
) -> dict[str, Tensor]:
    """Return mean scores of a generator's reactions to the partners of real pairs, ``()`` each.

    ``motion`` is that of ``EnergyScore``; the others are those of ``contact_score``.
    """
    weights, motion_score = trapezoid_weights(model.points), EnergyScore(model.skeleton)
    normalise = model.normalisation.normalise_reaction
    scores = []
    for rows in torch.split(torch.arange(len(pairs), device=pairs.partner.device), batch_size):
        batch = pairs[rows]
        noise = model.sample_noise(n_samples * len(batch), random).to(rows.device)
        samples = sample_reactions(model, noise, batch)
        motion = motion_score(normalise(samples), normalise(batch.reaction), weights)
        scores.append({"motion": motion, **contact_score(samples, batch, weights)})
    return {name: torch.cat([part[name] for part in scores]).mean() for name in scores[0]}


def sample_reactions(model: Generator, noise: Tensor, pairs: MotionPairs) -> Tensor:
    """Generate S reactions to each of B partners.

    Parameters
    ----------
    model : Generator
    noise : (S B, k, 2 K)
    pairs : B of them

    Returns
    -------
    (S, B, N, 3 J) metres
    """
    n_samples = len(noise) // len(pairs)
    reactions: Tensor = model(noise, pairs.repeat(n_samples).condition)
    return reactions.view(n_samples, *pairs.reaction.shape)


def _l2_norm(motion: Tensor, weights: Tensor) -> Tensor:
    """``(..., T, C)`` to ``(...)``."""
    # The constant keeps the square root differentiable where motions are equal.
    norm: Tensor = (motion.square().mean(dim=-1) @ weights + 1e-8).sqrt()
    return norm
