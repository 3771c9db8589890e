"""Features of the Fréchet distance (FID): latents of an autoencoder of one character's motion.

The supplement does not define its features. These are the latents of an autoencoder whose encoder
is ST-GCN1 with fewer channels, trained on real motion. Distances compare only between equal
extractors, so the ``fingerprint`` is stored with them.
"""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.skeleton_prior.layers import (
    StGcnEncoder,
    encoder_channels,
    initialise_weights,
    off_diagonal_adjacency,
)
from pacmo_core.training.loop import TrainingLoop
from pacmo_core.training.supervised import SupervisedTrainer


@dataclass(frozen=True)
class FeatureExtractorSettings:
    """Size and training of the autoencoder."""

    random_seed: int
    hidden: int  # channels of the widest layer
    n_features: int  # of the latent
    n_frames: int  # of the encoder's input, evenly spaced over a motion of any length
    n_decoded_frames: int  # of the decoder's output, evenly spaced over the input
    learning_rate: float
    halve_learning_rate_every: int
    batch_size: int
    n_epochs: int


class FeatureExtractor(nn.Module):
    """Autoencoder of one character's motion in the canonical frame of the interaction."""

    def __init__(self, skeleton: Skeleton, settings: FeatureExtractorSettings) -> None:
        super().__init__()
        self.settings, self.skeleton = settings, skeleton
        hidden, joints = settings.hidden, len(skeleton.joints)
        self.encoder = StGcnEncoder(off_diagonal_adjacency(skeleton), 3, encoder_channels(hidden))
        self.latent = nn.Linear(hidden * joints, settings.n_features)
        self.decoder = nn.Sequential(
            nn.Linear(settings.n_features, hidden),
            nn.ReLU(),
            nn.Linear(hidden, settings.n_decoded_frames * joints * 3),
        )

    def forward(self, motions: Tensor) -> Tensor:
        """Encode motions ``(B, K, J, 3)``, metres, as latents (B, D)."""
        latent: Tensor = self.latent(self.encoder(motions.permute(0, 3, 1, 2)).flatten(1))
        return latent

    def loss(self, motions: Tensor) -> Tensor:
        """Compute the mean squared reconstruction error of (B, K, J, 3), square metres."""
        n_frames = self.settings.n_decoded_frames
        frames = torch.linspace(0, motions.shape[1] - 1, n_frames).round().long()
        return nn.functional.mse_loss(self.decoder(self(motions)), motions[:, frames].flatten(1))

    def features(self, motions: Sequence[NDArray[np.float32]]) -> NDArray[np.float64]:
        """Compute features (n, D) of motions (T_i, J, 3) float32, metres, in canonical frames."""
        self.eval()
        with torch.inference_mode():
            rows = [self(self.resample(motion)[None]) for motion in motions]
        return torch.cat(rows).double().numpy()

    def resample(self, motion: NDArray[np.float32]) -> Tensor:
        """Select the input frames (K, J, 3) of a motion (T, J, 3)."""
        frames = np.linspace(0, len(motion) - 1, self.settings.n_frames).round().astype(int)
        return torch.from_numpy(motion[frames])


def build_extractor_training(
    motions: Sequence[NDArray[np.float32]], skeleton: Skeleton, settings: FeatureExtractorSettings
) -> TrainingLoop[FeatureExtractor]:
    """Build the training loop of an extractor on motions (T_i, J, 3) float32, metres."""
    random = torch.Generator().manual_seed(settings.random_seed)
    model = FeatureExtractor(skeleton, settings)
    initialise_weights(model, random)
    inputs = torch.stack([model.resample(motion) for motion in motions])
    trainer = SupervisedTrainer(
        model, len(inputs), lambda rows: model.loss(inputs[rows]), None, settings, random
    )
    return TrainingLoop(trainer, n_epochs=settings.n_epochs, validate_every=settings.n_epochs)


def fingerprint(model: FeatureExtractor) -> str:
    """Hash configuration and weights by SHA-256, in hexadecimal, to identify the features."""
    config: dict[str, Any] = {"skeleton": asdict(model.skeleton), **asdict(model.settings)}
    digest = hashlib.sha256(json.dumps(config, sort_keys=True).encode())
    for name, tensor in sorted(model.state_dict().items()):
        digest.update(name.encode() + tensor.detach().cpu().contiguous().numpy().tobytes())
    return digest.hexdigest()
