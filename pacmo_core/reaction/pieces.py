"""What a model is asked at a time: a window of a partner's motion, its frame and its noise."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pacmo_core.data.interaction import Motion
from pacmo_core.data.transforms import Frame, body_frame
from pacmo_core.operators.encode import Spline
from pacmo_core.reaction.denoise import Denoised
from pacmo_core.reaction.generator import Generator
from pacmo_core.reaction.gru import Gru
from pacmo_core.reaction.labels import numbers_of
from pacmo_core.reaction.windows import EndlessNoise, Window, cut, shares

Reactor = Generator | Gru


@dataclass(frozen=True)
class Partner:
    """A motion to react to, and when the reaction is wanted.

    Parameters
    ----------
    motion : (T, J, 3) float32, metres, in the world
    times : (T,) float64, seconds, strictly increasing
    out_times : (T_out,) float64, seconds, ascending, within ``times``
    action : the interaction's label, for a model that was trained on labels; else empty
    """

    motion: Motion
    times: NDArray[np.float64]
    out_times: NDArray[np.float64]
    action: str = ""


@dataclass(frozen=True)
class Piece:
    """One window of a partner's motion, and what of the reaction it answers for.

    Parameters
    ----------
    owner : which partner
    motion : spline of the partner in the world
    window : Window
    frame : of the partner at the window's start
    noise : (S, k, 2 K) coefficients; none for the baseline
    action : number of the label; 0 where labels are no condition
    rows : of the reaction
    instants : (rows,) float64, seconds
    weights : (rows,) float64, the window's share at each
    """

    owner: int
    motion: Spline
    window: Window
    frame: Frame
    noise: Tensor
    action: int
    rows: slice
    instants: NDArray[np.float64]
    weights: NDArray[np.float64]

    def local(self, instants: NDArray[np.float64]) -> NDArray[np.float32]:
        """``(N, 3 J)``: the partner at instants, seen from the frame."""
        return self.frame.to_local(poses(self.motion, instants)).reshape(len(instants), -1)


def pieces_of(
    model: Reactor, partners: Sequence[Partner], n_samples: int, random: torch.Generator
) -> Iterator[Piece]:
    """Cut every partner into windows, when their turn comes."""
    for owner, partner in enumerate(partners):
        motion = Denoised(partner.times, partner.motion)
        motion.check(partner.out_times)
        windows = cut(motion.start, motion.end, model.normalisation)
        noise = endless_noise(model, n_samples, random)
        action = action_number(model, partner.action)
        for window, (rows, weights) in zip(
            windows, shares(windows, partner.out_times), strict=True
        ):
            if not len(weights):
                continue  # nobody asks for what this window could answer
            shift = (window.start - motion.start) / window.duration
            yield Piece(
                owner=owner,
                motion=motion,
                window=window,
                frame=body_frame(poses(motion, np.array([window.start])), model.skeleton),
                noise=noise.at(shift) if noise else torch.zeros(0),
                action=action,
                rows=rows,
                instants=partner.out_times[rows],
                weights=weights,
            )


def endless_noise(model: Reactor, n_samples: int, random: torch.Generator) -> EndlessNoise | None:
    """Make the noise of so many reactions to one partner; the baseline takes none."""
    if n_samples < 1 or (is_deterministic(model) and n_samples != 1):
        wanted = "1: the model is deterministic" if is_deterministic(model) else "1 or more"
        raise ValueError(f"n_samples must be {wanted}; got {n_samples}")
    if isinstance(model, Gru):
        return None
    return EndlessNoise(model.config.noise, lambda: model.draw(n_samples, random))


def is_deterministic(model: Reactor) -> bool:
    """Say whether a model has one reaction to a partner and no noise."""
    return isinstance(model, Gru) or not model.config.noise_channels


def action_number(model: Reactor, action: str) -> int:
    """Look up a label; a model without labels takes none."""
    known = () if isinstance(model, Gru) else model.config.actions
    if not known and not action:
        return 0
    return int(numbers_of([action], known))


def poses(motion: Spline, instants: NDArray[np.float64]) -> Motion:
    """``(N, J, 3)`` float32: a motion at instants."""
    found: Motion = motion(instants).astype(np.float32)
    return found
