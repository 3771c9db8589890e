"""The deterministic baseline: stacked GRU layers over a partner's frames (PaCMO, 4.3.2)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.utils.rnn import pad_sequence

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.data.transforms import frame_of
from pacmo_core.operators.encode import Spline
from pacmo_core.operators.initialise import initialise
from pacmo_core.reaction.fit import Fit
from pacmo_core.reaction.functions import both_sides, common_skeleton, encode
from pacmo_core.reaction.normalisation import Normalisation
from pacmo_core.reaction.settings import GruSettings
from pacmo_core.reaction.supervised import Supervised
from pacmo_core.reaction.tensors import skeleton_from


@dataclass(frozen=True)
class GruConfig:
    """A recurrent network's skeleton and size."""

    skeleton: Skeleton
    fps: float
    hidden: int
    n_layers: int


@dataclass(frozen=True)
class Frames:
    """Partners and reactions at one rate, one tensor a clip.

    Parameters
    ----------
    partner, reaction : list of (T_i, 3 J) float32, metres, in the partner's first frame
    """

    partner: list[Tensor]
    reaction: list[Tensor]


class Gru(nn.Module):
    """Five GRU layers of 200 and three dense ones with GELU, in the paper's size.

    Causal, so frames of padding after a clip do not change it.

    Parameters
    ----------
    config : GruConfig
    """

    def __init__(self, config: GruConfig) -> None:
        super().__init__()
        self.config = config
        channels, hidden = 3 * len(config.skeleton.joints), config.hidden
        self.gru = nn.GRU(channels, hidden, config.n_layers, batch_first=True)
        self.head = nn.Sequential(
            nn.Linear(hidden, hidden),
            nn.GELU(),
            nn.Linear(hidden, hidden),
            nn.GELU(),
            nn.Linear(hidden, channels),
        )
        self.normalisation = Normalisation(channels=channels)

    @property
    def skeleton(self) -> Skeleton:
        """Whose joints go in and come out."""
        return self.config.skeleton

    def forward(self, partner: Tensor) -> Tensor:
        """React frame by frame: ``(B, T, 3 J)`` metres to the same."""
        hidden, _ = self.gru(self.normalisation.partner(partner))
        out: Tensor = self.head(hidden)
        return self.normalisation.metres(out)

    def loss(self, frames: Frames, rows: Sequence[int]) -> Tensor:
        """Take the mean squared error over real frames, in normalised units."""
        partner = pad_sequence([frames.partner[i] for i in rows], batch_first=True)
        reaction = pad_sequence([frames.reaction[i] for i in rows], batch_first=True)
        lengths = torch.tensor([len(frames.partner[i]) for i in rows], device=partner.device)
        here = torch.arange(partner.shape[1], device=partner.device) < lengths[:, None]
        error = (self(partner) - reaction).square().mean(dim=-1) / self.normalisation.scale**2
        return torch.masked_select(error, here).mean()


def frame_times(start: float, end: float, fps: float) -> NDArray[np.float64]:
    """Space instants evenly, both ends among them, as near to a rate as that allows."""
    return np.linspace(start, end, max(2, round((end - start) * fps) + 1))


def fit(
    clips: Sequence[Interaction],
    settings: GruSettings,
    *,
    validation: Sequence[Interaction] = (),
    device: str = "cpu",
) -> Fit[Gru]:
    """Train on squared error; an epoch yields ``loss``.

    ``validation`` is the loss on either side of the held-out clips.
    """
    common_skeleton([*clips, *validation])
    random = torch.Generator().manual_seed(settings.random_seed)
    sides = both_sides(clips, swap=settings.swap)
    frames = frames_of(sides, settings.fps, device)
    held_out = frames_of(both_sides(validation, swap=True), settings.fps, device)
    config = GruConfig(clips[0].skeleton, settings.fps, settings.hidden, settings.n_layers)
    model = Gru(config)
    initialise(model, random)
    model.to(device).normalisation.measure(encode(sides, n_points=33).to(device))
    training = Supervised(
        model,
        len(frames.partner),
        lambda rows: model.loss(frames, rows.tolist()),
        (lambda: model.loss(held_out, range(len(held_out.partner)))) if validation else None,
        settings,
        random,
    )
    return Fit(training, n_epochs=settings.n_epochs, validate_every=settings.validate_every)


def from_state(config: Mapping[str, Any], state: Mapping[str, Tensor]) -> Gru:
    """Rebuild a model from what ``config`` and ``fit.state`` gave."""
    model = Gru(GruConfig(**{**config, "skeleton": skeleton_from(config["skeleton"])}))
    model.load_state_dict(dict(state))
    return model.requires_grad_(False)


def frames_of(clips: Sequence[Interaction], fps: float, device: str) -> Frames:
    """Sample interactions at one rate: ``person_a`` the partner, ``person_b`` reacts."""
    frames = Frames([], [])
    for clip in clips:
        frame = frame_of(clip.person_a, clip.skeleton)
        at = frame_times(clip.times[0], clip.times[-1], fps)
        for motion, found in ((clip.person_a, frames.partner), (clip.person_b, frames.reaction)):
            local = frame.to_local(motion).reshape(len(motion), -1)
            values = Spline(clip.times, local)(at).astype(np.float32)
            found.append(torch.tensor(values, device=device))
    return frames
