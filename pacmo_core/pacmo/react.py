"""Reactions in the world to a partner's motion, at any instants."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pacmo_core.interaction import Motion
from pacmo_core.operators.encode import Spline
from pacmo_core.pacmo.generator import Generator
from pacmo_core.pacmo.gru import Gru, frame_times
from pacmo_core.skeleton import Skeleton
from pacmo_core.transform import Frame, frame_of

Reactor = Generator | Gru


@dataclass(frozen=True)
class Partner:
    """A motion to react to, and when the reaction is wanted.

    Parameters
    ----------
    motion : (T, J, 3) float32, metres, in the world
    times : (T,) float64, seconds, strictly increasing
    out_times : (T_out,) float64, seconds, within ``times``
    """

    motion: Motion
    times: NDArray[np.float64]
    out_times: NDArray[np.float64]

    def frame(self, skeleton: Skeleton) -> Frame:
        """Find the frame of the first pose."""
        return frame_of(self.motion, skeleton)

    def spline(self, frame: Frame) -> Spline:
        """Pass a cubic spline through the local motion, ``3 J`` channels."""
        return Spline(self.times, frame.to_local(self.motion).reshape(len(self.motion), -1))

    @property
    def duration(self) -> float:
        """Seconds from the first frame to the last."""
        return float(self.times[-1] - self.times[0])


def react(
    model: Reactor,
    partner: Motion,
    times: NDArray[np.float64],
    *,
    out_times: NDArray[np.float64],
    n_samples: int,
    random: torch.Generator,
) -> Motion:
    """React to one partner.

    Parameters
    ----------
    model : a generator, or the deterministic baseline
    partner : (T, J, 3) float32, metres, in the world
    times, out_times : (T,), (T_out,) float64, seconds; the latter within the former
    n_samples : S; 1 for the baseline
    random : CPU generator of the noise

    Returns
    -------
    (S, T_out, J, 3) float32, metres, in the world

    Raises
    ------
    ValueError
        If a shape is wrong, an instant is outside ``times``, or the baseline is asked for many.
    """
    partners = [Partner(partner, times, out_times)]
    return react_all(model, partners, n_samples=n_samples, random=random)[0]


def react_all(
    model: Reactor, partners: Sequence[Partner], *, n_samples: int, random: torch.Generator
) -> list[Motion]:
    """React to many partners of any lengths and rates in one batch: ``(S, T_out_i, J, 3)`` each.

    Noise is drawn partner by partner, so that the first reactions do not depend on later partners.
    """
    n_joints = len(model.skeleton.joints)
    for partner in partners:
        if partner.motion.shape != (len(partner.times), n_joints, 3):
            raise ValueError(
                f"partner must be ({len(partner.times)}, {n_joints}, 3); got {partner.motion.shape}"
            )
    frames = [partner.frame(model.skeleton) for partner in partners]
    with torch.no_grad():
        if isinstance(model, Generator):
            local = _generate(model, partners, frames, n_samples, random)
        elif n_samples == 1:
            local = [_predict(model, *pair)[None] for pair in zip(partners, frames, strict=True)]
        else:
            raise ValueError(f"the baseline is deterministic: wanted 1 sample; got {n_samples}")
    return [
        frame.to_world(motion.reshape(*motion.shape[:2], n_joints, 3))
        for frame, motion in zip(frames, local, strict=True)
    ]


def _generate(
    model: Generator,
    partners: Sequence[Partner],
    frames: Sequence[Frame],
    n_samples: int,
    random: torch.Generator,
) -> list[NDArray[np.float32]]:
    device, n_points = model.points.device, model.config.uno.n_points
    splines = [partner.spline(frame) for partner, frame in zip(partners, frames, strict=True)]
    noise = torch.stack([model.draw(n_samples, random) for _ in partners]).to(device)
    grid = _tensor(np.stack([spline.on_grid(n_points) for spline in splines]), device)
    log_duration = _tensor(np.log([partner.duration for partner in partners]), device)
    latent = model.latent(
        noise.flatten(0, 1),
        grid.repeat_interleave(n_samples, dim=0),
        log_duration.repeat_interleave(n_samples),
    )
    latent = latent.view(len(latent), len(partners), n_samples, -1)
    found = []
    for i, (partner, spline) in enumerate(zip(partners, splines, strict=True)):
        at = torch.from_numpy((partner.out_times - partner.times[0]) / partner.duration).to(device)
        motion = _tensor(spline(partner.out_times), device).expand(n_samples, -1, -1)
        reaction = model.at(latent[:, i], noise[i], motion, log_duration[i].expand(n_samples), at)
        found.append(reaction.cpu().numpy())
    return found


def _predict(model: Gru, partner: Partner, frame: Frame) -> NDArray[np.float32]:
    device = model.normalisation.scale.device
    at = frame_times(partner.times[0], partner.times[-1], model.config.fps)
    reaction = model(_tensor(partner.spline(frame)(at), device)[None])[0].cpu().numpy()
    return Spline(at, reaction)(partner.out_times).astype(np.float32)


def _tensor(values: NDArray[np.float64], device: torch.device) -> Tensor:
    return torch.tensor(values.astype(np.float32), device=device)
