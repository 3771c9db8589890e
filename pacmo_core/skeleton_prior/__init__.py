"""Skeleton priors: variational autoencoders (VAEs) that retarget a two-person motion to skeletons.

After Li et al. (2024), *Two-person interaction augmentation with skeleton priors*. A skeleton prior
is trained on variations that the InteractionMesh solver made, and generates variations on given or
sampled skeletons in one forward pass. Tables and equations cited here are those of its supplement.

    from pacmo_core import skeleton_prior

    model = skeleton_prior.build_training(examples, settings, validation=examples).finish()
    variations = skeleton_prior.retarget(model, source, scales, samples=4, random=random)

Names are imported when they are first used: their modules import torch.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pacmo_core.skeleton_prior.data import Example, encode_examples
    from pacmo_core.skeleton_prior.inference import generate_skeletons, retarget
    from pacmo_core.skeleton_prior.settings import SkeletonPriorSettings
    from pacmo_core.skeleton_prior.training import build_training
    from pacmo_core.skeleton_prior.vae import SkeletonPrior

__all__ = [
    "Example",
    "SkeletonPrior",
    "SkeletonPriorSettings",
    "build_training",
    "encode_examples",
    "generate_skeletons",
    "retarget",
]
_MODULES = {
    "Example": "data",
    "SkeletonPrior": "vae",
    "SkeletonPriorSettings": "settings",
    "build_training": "training",
    "encode_examples": "data",
}


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULES.get(name, 'inference')}"), name)
