"""One partner sampled at different times, and the mismatch of a model's reactions."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from pacmo_core.data.interaction import Motion
from pacmo_core.data.transforms import body_frame
from pacmo_core.operators.random_field import GaussianRandomField
from pacmo_core.operators.spline import Spline
from pacmo_core.reaction.generator import Generator
from pacmo_core.reaction.inference import react_all
from pacmo_core.reaction.windows import PartnerMotion, mean_duration

Times = NDArray[np.float64]

FIELD = GaussianRandomField(alpha=2.0, tau=5.0, n_frequencies=16, period=1.25)
SWAY = 0.1  # metres, standard deviation of each coordinate of each joint
N_INSTANTS = 101
N_NOISES = 2


@dataclass(frozen=True)
class Sampled:
    """A partner's frames: ``motion`` (T, J, 3) metres at ``times`` (T,) seconds."""

    motion: Motion
    times: Times

    def first(self, count: int) -> "Sampled":
        """Keep the first frames."""
        return Sampled(self.motion[:count], self.times[:count])

    def finer(self, random: np.random.Generator) -> "Sampled":
        """Sample the spline through the frames at 2 T - 1 jittered times."""
        even = np.linspace(self.times[0], self.times[-1], 2 * len(self.times) - 1)
        times = jittered(even, random)
        return Sampled(Spline(self.times, self.motion)(times).astype(np.float32), times)

    def only(self, rows: NDArray[np.intp]) -> "Sampled":
        """Select frames."""
        return Sampled(self.motion[rows], self.times[rows])


@dataclass(frozen=True)
class Smooth:
    """A partner as a function of time: a pose, and a random field that moves its joints."""

    pose: Motion
    coefficients: torch.Tensor
    duration: float

    def at(self, fractions: Times) -> Sampled:
        """Sample at fractions of the duration."""
        field = FIELD.evaluate(self.coefficients[None], torch.from_numpy(fractions))[0].numpy()
        motion = self.pose + SWAY * field.reshape(-1, *self.pose.shape)
        return Sampled(motion.astype(np.float32), fractions * self.duration)


@dataclass(frozen=True)
class Mismatch:
    """Relative L2 distances.

    Parameters
    ----------
    out : of reactions, metres in the partner's frame
    varying : of reactions, relative to their variation about the model's mean reaction
    into : of the inputs, relative to their variation about the model's mean partner
    """

    out: float
    varying: float
    into: float


def smooth_partners(model: Generator, count: int) -> list[Smooth]:
    """Return the model's mean partner, moved by random fields."""
    pose = model.normalisation.partner_mean.numpy().reshape(-1, 3)
    random = torch.Generator().manual_seed(0)
    duration = mean_duration(model.normalisation)
    return [Smooth(pose, FIELD.sample(pose.size, random=random), duration) for _ in range(count)]


def jittered(times: Times, random: np.random.Generator) -> Times:
    """Move inner times by up to 40 % of a step."""
    moved = times.copy()
    moved[1:-1] += random.uniform(-0.4, 0.4, len(times) - 2) * (times[1] - times[0])
    return moved


def random_subset(count: int, random: np.random.Generator) -> NDArray[np.intp]:
    """Return the frames that remain when 30 % of the inner ones are dropped."""
    inner = 1 + random.permutation(count - 2)[: round(0.7 * (count - 2))]
    return np.concatenate([[0], np.sort(inner), [count - 1]])


def mismatch(model: Generator, base: Sequence[Sampled], other: Sequence[Sampled]) -> Mismatch:
    """Compare reactions, and inputs, of the same partners sampled in two ways."""
    fractions = np.linspace(0, 1, N_INSTANTS)
    instants = [b.times[0] + fractions * (b.times[-1] - b.times[0]) for b in base]
    norm = model.normalisation
    reactions = [_reactions(model, partners, instants) for partners in (base, other)]
    inputs = [_inputs(model, partners, instants) for partners in (base, other)]
    return Mismatch(
        out=_distance(reactions, np.zeros(())),
        varying=_distance(reactions, norm.reaction_mean.numpy()),
        into=_distance(inputs, norm.partner_mean.numpy()),
    )


def _distance(pair: Sequence[NDArray[np.float64]], about: NDArray[np.floating]) -> float:
    a, b = pair
    return float(np.linalg.norm(a - b) / np.linalg.norm(a - about))


def _reactions(
    model: Generator, partners: Sequence[Sampled], instants: Sequence[Times]
) -> NDArray[np.float64]:
    """Return ``(P, S, N, 3 J)`` metres in the partners' frames."""
    queries = [
        PartnerMotion(p.motion, p.times, at) for p, at in zip(partners, instants, strict=True)
    ]
    random = torch.Generator().manual_seed(0)
    motions = react_all(model, queries, n_samples=N_NOISES, random=random)
    return np.stack([_local(model, p, m) for p, m in zip(partners, motions, strict=True)])


def _inputs(
    model: Generator, partners: Sequence[Sampled], instants: Sequence[Times]
) -> NDArray[np.float64]:
    """Return ``(P, N, 3 J)`` metres in the partners' frames."""
    motions = [Spline(p.times, p.motion)(at) for p, at in zip(partners, instants, strict=True)]
    return np.stack([_local(model, p, m) for p, m in zip(partners, motions, strict=True)])


def _local(model: Generator, partner: Sampled, motion: NDArray[np.floating]) -> NDArray[np.float64]:
    local = body_frame(partner.motion, model.skeleton).to_local(motion.astype(np.float32))
    return local.reshape(*motion.shape[:-2], -1).astype(np.float64)
