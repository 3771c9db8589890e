"""Configurations as JSON and back, so that a checkpoint says what it is."""

from collections.abc import Mapping
from typing import Any, Protocol

from pacmo_core.operators.random_field import RandomField
from pacmo_core.operators.uno import UnoConfig, u_channels

# What five of the seven grids are of the latent one; the fourth layer is the bottleneck.
RATIOS = (0.75, 0.5, 0.25, 0.25, 0.5, 0.75, 1.0)


class TrunkSettings(Protocol):
    """What a section of ``params.yaml`` says about its operators."""

    @property
    def n_points(self) -> int:
        """Grid on [0, 1]."""

    @property
    def period(self) -> float:
        """Of the latent grid."""

    @property
    def width(self) -> int:
        """Channels of the lifted function."""

    @property
    def modes(self) -> list[int]:
        """Of the seven layers."""


def trunk(settings: TrunkSettings, in_channels: int, out_channels: int) -> UnoConfig:
    """Shape a U-NO of seven layers with skips."""
    return UnoConfig(
        in_channels=in_channels,
        out_channels=out_channels,
        lifting=settings.width,
        channels=u_channels(settings.width),
        modes=tuple(settings.modes),
        ratios=RATIOS,
        n_points=settings.n_points,
        period=settings.period,
        skips=True,
    )


def uno_from(facts: Mapping[str, Any]) -> UnoConfig:
    """Rebuild the shape of an operator."""
    tuples = {key: tuple(facts[key]) for key in ("channels", "modes", "ratios")}
    return UnoConfig(**{**facts, **tuples})


def noise_from(facts: Mapping[str, Any]) -> RandomField:
    """Rebuild a random field."""
    return RandomField(**facts)
