"""The features of the Fréchet distance: a small auto-encoder of one character's motion.

The supplement does not say what its features are. Ours are the code of an auto-encoder whose
encoder is ST-GCN1 with fewer channels, trained on real motion; its figures compare with nothing
but themselves, so ``fingerprint`` goes with them.
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
    """How the features are learnt.

    Parameters
    ----------
    random_seed : int
    hidden, features : channels of the widest layer, and of the code
    frames : that it sees, spread evenly over a motion of any length
    instants : at which the decoder gives the motion back
    learning_rate, halve_learning_rate_every, batch_size, n_epochs : of the descent
    """

    random_seed: int
    hidden: int
    features: int
    frames: int
    instants: int
    learning_rate: float
    halve_learning_rate_every: int
    batch_size: int
    n_epochs: int


class FeatureExtractor(nn.Module):
    """Encode a character's motion in the pair's frame, and give it back at a few instants.

    Parameters
    ----------
    skeleton : Skeleton
    settings : ExtractorSettings
    """

    def __init__(self, skeleton: Skeleton, settings: FeatureExtractorSettings) -> None:
        super().__init__()
        self.settings, self.skeleton = settings, skeleton
        hidden, joints = settings.hidden, len(skeleton.joints)
        self.encoder = StGcnEncoder(
            off_diagonal_adjacency(skeleton), 3, encoder_channels(hidden), dropout=0.0
        )
        self.code = nn.Linear(hidden * joints, settings.features)
        self.back = nn.Sequential(
            nn.Linear(settings.features, hidden),
            nn.ReLU(),
            nn.Linear(hidden, settings.instants * joints * 3),
        )

    def forward(self, motions: Tensor) -> Tensor:
        """``(B, K, J, 3)`` metres at keyframes to ``(B, D)``."""
        code: Tensor = self.code(self.encoder(motions, None).flatten(1))
        return code

    def loss(self, motions: Tensor) -> Tensor:
        """Take the mean squared error of the motion given back, metres squared."""
        at = torch.linspace(0, motions.shape[1] - 1, self.settings.instants).round().long()
        wanted = motions[:, at].flatten(1)
        return nn.functional.mse_loss(self.back(self(motions)), wanted)

    def features(self, motions: Sequence[NDArray[np.float32]]) -> NDArray[np.float64]:
        """``(n, D)`` of motions (T_i, J, 3) float32, metres, in the pair's canonical frame."""
        self.eval()
        with torch.inference_mode():
            rows = [self(self.seen(motion)[None]) for motion in motions]
        return torch.cat(rows).double().numpy()

    def seen(self, motion: NDArray[np.float32]) -> Tensor:
        """``(K, J, 3)``: the frames of a motion (T, J, 3) that it sees."""
        at = np.linspace(0, len(motion) - 1, self.settings.frames).round().astype(int)
        return torch.from_numpy(motion[at])


def build_extractor_training(
    motions: Sequence[NDArray[np.float32]], skeleton: Skeleton, settings: FeatureExtractorSettings
) -> TrainingLoop[FeatureExtractor]:
    """Train on motions (T_i, J, 3) float32, metres."""
    random = torch.Generator().manual_seed(settings.random_seed)
    model = FeatureExtractor(skeleton, settings)
    initialise_weights(model, random)
    seen = torch.stack([model.seen(motion) for motion in motions])
    training = SupervisedTrainer(
        model, len(seen), lambda rows: model.loss(seen[rows]), None, settings, random
    )
    return TrainingLoop(training, n_epochs=settings.n_epochs, validate_every=settings.n_epochs)


def fingerprint(model: FeatureExtractor) -> str:
    """SHA-256 of the configuration and the weights, in hexadecimal: what the features are."""
    facts: dict[str, Any] = {"skeleton": asdict(model.skeleton), **asdict(model.settings)}
    digest = hashlib.sha256(json.dumps(facts, sort_keys=True).encode())
    for name, tensor in sorted(model.state_dict().items()):
        digest.update(name.encode() + tensor.detach().cpu().contiguous().numpy().tobytes())
    return digest.hexdigest()
