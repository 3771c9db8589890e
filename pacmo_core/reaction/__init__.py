"""Reaction generation: PaCMO's conditional WGAN, baselines, feature networks and inference.

    from pacmo_core import reaction

    motions = reaction.react(model, partner, times, out_times=times, n_samples=4, random=random)

Names are imported when they are first used: their modules import torch.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pacmo_core.reaction.autoencoder import Autoencoder, encode_features
    from pacmo_core.reaction.data import to_partner_frame
    from pacmo_core.reaction.generator import Generator
    from pacmo_core.reaction.inference import finish_reactions, react, react_all
    from pacmo_core.reaction.stream import ReactionStream
    from pacmo_core.reaction.windows import PartnerMotion, ReactionModel, is_deterministic

__all__ = [
    "Autoencoder",
    "Generator",
    "PartnerMotion",
    "ReactionModel",
    "ReactionStream",
    "encode_features",
    "finish_reactions",
    "is_deterministic",
    "react",
    "react_all",
    "to_partner_frame",
]
_MODULES = {
    "Autoencoder": "autoencoder",
    "Generator": "generator",
    "PartnerMotion": "windows",
    "ReactionModel": "windows",
    "ReactionStream": "stream",
    "encode_features": "autoencoder",
    "is_deterministic": "windows",
    "to_partner_frame": "data",
}


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULES.get(name, 'inference')}"), name)
