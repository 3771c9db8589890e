"""Configurations as JSON and back, so that a checkpoint says what it is."""

from collections.abc import Mapping
from typing import Any

from pacmo_core.operators.random_field import RandomField
from pacmo_core.operators.uno import UnoConfig
from pacmo_core.skeleton import Skeleton

# What five of the seven grids are of the latent one; the fourth layer is the bottleneck.
RATIOS = (0.75, 0.5, 0.25, 0.25, 0.5, 0.75, 1.0)


def skeleton_from(facts: Mapping[str, Any]) -> Skeleton:
    """Rebuild a skeleton from ``dataclasses.asdict`` of one, through JSON or not."""
    return Skeleton(
        name=facts["name"],
        joints=tuple(facts["joints"]),
        parents=tuple(facts["parents"]),
        left_right=tuple((left, right) for left, right in facts["left_right"]),
    )


def uno_from(facts: Mapping[str, Any]) -> UnoConfig:
    """Rebuild the shape of an operator."""
    tuples = {key: tuple(facts[key]) for key in ("channels", "modes", "ratios")}
    return UnoConfig(**{**facts, **tuples})


def noise_from(facts: Mapping[str, Any]) -> RandomField:
    """Rebuild a random field."""
    return RandomField(**facts)
