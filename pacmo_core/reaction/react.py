"""Reactions in the world to a partner's motion of any length, at any instants."""

from collections.abc import Iterator, Sequence
from itertools import islice

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pacmo_core.data.interaction import Motion
from pacmo_core.operators.spline import Spline
from pacmo_core.reaction.baselines import Gru, frame_times
from pacmo_core.reaction.data import Condition
from pacmo_core.reaction.generator import Generator
from pacmo_core.reaction.windows import PartnerMotion, ReactionModel, WindowQuery, window_queries

# What bounds memory: motions that go through the layers, and instants through the head, at once.
MAX_MOTIONS_PER_BATCH = 64
MAX_TIMES_PER_BATCH = 4096


def react(
    model: ReactionModel,
    partner: Motion,
    times: NDArray[np.float64],
    *,
    out_times: NDArray[np.float64],
    n_samples: int,
    random: torch.Generator,
) -> Motion:
    """React to one partner, without a label; with one, ``react_all``.

    A motion longer than the model's training clips is taken in overlapping windows; time and
    memory grow linearly with its length.

    Parameters
    ----------
    model : a generator, or the deterministic baseline
    partner : (T, J, 3) float32, metres, in the world
    times, out_times : (T,), (T_out,) float64, seconds; the latter ascending, within the former
    n_samples : S; 1 for the baseline
    random : CPU generator of the noise

    Returns
    -------
    (S, T_out, J, 3) float32, metres, in the world

    Raises
    ------
    ValueError
        If a shape is wrong, an instant is outside ``times``, a model without noise is
        asked for many, or the model wants a label.
    """
    partners = [PartnerMotion(partner, times, out_times)]
    return react_all(model, partners, n_samples=n_samples, random=random)[0]


def react_all(
    model: ReactionModel,
    partners: Sequence[PartnerMotion],
    *,
    n_samples: int,
    random: torch.Generator,
) -> list[Motion]:
    """React to many partners of any lengths and rates, in batches: ``(S, T_out_i, J, 3)`` each.

    Noise is drawn partner by partner, so that the first reactions do not depend on later partners.
    """
    n_joints = len(model.skeleton.joints)
    found: list[Motion] = []
    for partner in partners:
        _check_partner(partner, n_joints)
        found.append(np.zeros((n_samples, len(partner.out_times), n_joints, 3), np.float32))
    pieces = window_queries(model, partners, n_samples, random)
    with torch.no_grad():
        while block := list(islice(pieces, max(1, MAX_MOTIONS_PER_BATCH // n_samples))):
            for piece, local in zip(block, evaluate_queries(model, block), strict=True):
                motion = piece.frame.to_world(local.reshape(*local.shape[:2], n_joints, 3))
                weights = piece.weights.astype(np.float32)[:, None, None]
                found[piece.owner][:, piece.rows] += weights * motion
    return found


def sample_times(times: NDArray[np.float64], fps: float) -> NDArray[np.float64]:
    """List the instants of a steady rate, from the first of ``times`` to the last at most."""
    if not fps > 0:
        raise ValueError(f"fps must be > 0; got {fps}")
    # A rounding error must not cost the last frame.
    count = int(np.floor((times[-1] - times[0]) * fps + 1e-6)) + 1
    at: NDArray[np.float64] = np.minimum(times[0] + np.arange(count) / fps, times[-1])
    return at


def _check_partner(partner: PartnerMotion, n_joints: int) -> None:
    if partner.motion.shape != (len(partner.times), n_joints, 3):
        raise ValueError(
            f"partner must be ({len(partner.times)}, {n_joints}, 3); got {partner.motion.shape}"
        )
    steps = np.diff(partner.out_times)
    if not len(partner.out_times) or (steps < 0).any():
        raise ValueError("out_times must ascend and not be empty")


def evaluate_queries(
    model: ReactionModel, pieces: Sequence[WindowQuery]
) -> Iterator[NDArray[np.float32]]:
    """Give ``(S, rows, 3 J)`` metres in the frame, piece by piece, all of one number of samples."""
    if isinstance(model, Generator):
        return _evaluate_generator(model, pieces)
    return (_evaluate_gru(model, piece) for piece in pieces)


def _evaluate_generator(
    model: Generator, pieces: Sequence[WindowQuery]
) -> Iterator[NDArray[np.float32]]:
    device = model.points.device
    n_samples = len(pieces[0].noise)
    noise = torch.stack([piece.noise for piece in pieces]).to(device)
    grid = torch.stack([_sample_on_grid(piece, model.config.uno.n_points) for piece in pieces]).to(
        device
    )
    durations = np.array([piece.window.duration for piece in pieces])
    log_duration = torch.tensor(np.log(durations).astype(np.float32), device=device)
    action = torch.tensor([piece.action for piece in pieces], device=device)
    condition = Condition(
        grid.repeat_interleave(n_samples, dim=0),
        log_duration.repeat_interleave(n_samples),
        action.repeat_interleave(n_samples),
    )
    latent = model.latent(noise.flatten(0, 1), condition)
    latent = latent.view(len(latent), len(pieces), n_samples, -1)
    for i, piece in enumerate(pieces):
        parts = []
        for first in range(0, len(piece.instants), MAX_TIMES_PER_BATCH):
            at = piece.instants[first : first + MAX_TIMES_PER_BATCH]
            condition = Condition(
                torch.tensor(piece.local(at), device=device).expand(n_samples, -1, -1),
                log_duration[i].expand(n_samples),
                action[i].expand(n_samples),
            )
            shares_of = torch.from_numpy(piece.window.inside(at)).to(device)
            parts.append(model.at(latent[:, i], noise[i], condition, shares_of))
        yield torch.cat(parts, dim=1).cpu().numpy()


def _sample_on_grid(piece: WindowQuery, n_points: int) -> Tensor:
    window = piece.window
    return torch.tensor(piece.local(np.linspace(window.start, window.end, n_points)))


def _evaluate_gru(model: Gru, piece: WindowQuery) -> NDArray[np.float32]:
    at = frame_times(piece.window.start, piece.window.end, model.config.fps)
    partner = torch.tensor(piece.local(at), device=model.normalisation.scale.device)
    reaction = model(partner[None]).cpu().numpy()
    motion: NDArray[np.float32] = Spline(at, reaction[0])(piece.instants)[None].astype(np.float32)
    return motion
