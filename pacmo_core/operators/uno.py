"""U-NO, a U-shaped neural operator of seven integral layers on functions of time over [0, 1].

Rahman, Ross and Azizzadenesheli (2022), *U-NO: U-shaped neural operators*; PaCMO, fig. 1.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import torch
from torch import Tensor, nn
from torch.nn import functional

from pacmo_core.data.limits import MAX_GRID, MAX_PARAMETERS
from pacmo_core.operators.spectral import (
    OperatorLayer,
    interpolation_matrix,
    periodic_extension_matrix,
)

# Layer whose output is concatenated to each layer's input, where grids are equal (PaCMO, fig. 1).
SKIPS = {4: 2, 5: 1, 6: 0}


@dataclass(frozen=True)
class UnoConfig:
    """The shape of a U-NO.

    Parameters
    ----------
    in_channels, out_channels : int
    lifting : channels of the lifted function
    channels : of each layer's output
    modes : of each layer's kernel; cut down to what the layer's grids resolve
    ratios : size of each layer's grid, relative to the latent one
    n_points : grid on [0, 1], both ends among them
    period : length of the latent grid; beyond 1 the function is extended to a periodic one
    skips : whether early layers are concatenated to late ones
    """

    in_channels: int
    out_channels: int
    lifting: int
    channels: tuple[int, ...]
    modes: tuple[int, ...]
    ratios: tuple[float, ...]
    n_points: int
    period: float
    skips: bool

    def __post_init__(self) -> None:
        counts = {len(self.channels), len(self.modes), len(self.ratios)}
        if len(counts) != 1 or (self.skips and counts != {7}):
            raise ValueError(
                "channels, modes and ratios must be as many as the layers, seven if there are "
                f"skips; got {len(self.channels)}, {len(self.modes)}, {len(self.ratios)}"
            )
        sizes = (self.in_channels, self.out_channels, self.lifting, *self.channels, *self.modes)
        if min(sizes) < 1:
            raise ValueError(f"channels and modes must be at least 1; got {min(sizes)}")
        exact = self.period * (self.n_points - 1)
        if self.period <= 1 or self.n_points < 4 or abs(exact - round(exact)) > 1e-9:
            raise ValueError(
                "period must exceed 1 and period * (n_points - 1) be whole, n_points >= 4; "
                f"got {self.period} * {self.n_points - 1}"
            )
        grid = max(self.n_points, self.n_latent, *self.sizes)
        if grid > MAX_GRID or self.n_parameters > MAX_PARAMETERS:
            raise ValueError(
                f"wanted grids of at most {MAX_GRID} points and {MAX_PARAMETERS} parameters; "
                f"got {grid} and {self.n_parameters}"
            )

    @property
    def n_latent(self) -> int:
        """Points of the latent grid, over the whole period."""
        return round(self.period * (self.n_points - 1))

    @property
    def n_parameters(self) -> int:
        """Parameters of the layers' kernels, without skips, and of the lifting: most of them."""
        widths = (self.lifting, *self.channels)
        kernels = zip(widths[:-1], widths[1:], self.modes, strict=True)
        ends = self.lifting * (self.in_channels + 4 * (self.channels[-1] + self.out_channels))
        return ends + sum(2 * c_in * c_out * n_modes for c_in, c_out, n_modes in kernels)

    @property
    def sizes(self) -> tuple[int, ...]:
        """Points of the grid after each layer."""
        return tuple(max(2, round(ratio * self.n_latent)) for ratio in self.ratios)


class Uno(nn.Module):
    """Map a function on [0, 1] to another, whose values can be computed at any times.

    Unlike Rahman et al. (2022), the layers have one latent grid, whatever grid the data
    had, and the last pointwise map is applied at the output times: so the output depends on the
    sampling only by the error of the spline that interpolates it.
    """

    extension: Tensor
    at_points: Tensor

    def __init__(self, config: UnoConfig) -> None:
        super().__init__()
        self.config = config
        self.lift = nn.Linear(config.in_channels, config.lifting)
        self.layers = nn.ModuleList(_layers(config))
        width = config.channels[-1] + (config.lifting if config.skips else 0)
        self.head = nn.Sequential(
            nn.Linear(width, 4 * config.lifting),
            nn.GELU(),
            nn.Linear(4 * config.lifting, config.out_channels),
        )
        extension = periodic_extension_matrix(config.n_points, config.n_latent)
        points = torch.linspace(0, 1, config.n_points, dtype=torch.float64)
        self.register_buffer("extension", extension.float(), persistent=False)
        self.register_buffer("at_points", self.evaluation(points), persistent=False)

    def forward(self, v: Tensor) -> Tensor:
        """Evaluate on the grid of the input: ``(B, N, C_in)`` to ``(B, N, C_out)``."""
        return self.evaluate(self.trunk(v), v, self.at_points)

    def trunk(self, v: Tensor) -> Tensor:
        """Apply the seven layers: ``(B, N, C_in)`` to ``(L, B, C)`` on the latent grid."""
        hidden = self._lift(v)
        outputs: list[Tensor] = []
        for i, layer in enumerate(self.layers):
            if self.config.skips and i in SKIPS:
                hidden = torch.cat([hidden, outputs[SKIPS[i]]], dim=-1)
            hidden = layer(hidden)
            outputs.append(hidden)
        return hidden

    def bottleneck(self, v: Tensor, n_layers: int) -> Tensor:
        """Apply the first ``n_layers`` layers, which have no skip inputs: ``(n, B, C)``."""
        hidden = self._lift(v)
        for layer in list(self.layers)[:n_layers]:
            hidden = layer(hidden)
        return hidden

    def evaluation(self, times: Tensor) -> Tensor:
        """Build the matrix ``(T, L)`` from the latent grid to times in [0, 1]."""
        return interpolation_matrix(times / self.config.period, self.config.n_latent).float()

    def evaluate(self, latent: Tensor, v_at: Tensor, evaluation: Tensor) -> Tensor:
        """Interpolate at times and apply the head pointwise.

        Parameters
        ----------
        latent : (L, B, C), of ``trunk``
        v_at : (B, T, C_in), the input function at the output times
        evaluation : (T, L), of ``evaluation``

        Returns
        -------
        (B, T, C_out)
        """
        local = (evaluation @ latent.flatten(1)).view(-1, *latent.shape[1:])
        if self.config.skips:
            lifted = functional.gelu(self.lift(v_at.transpose(0, 1)))
            local = torch.cat([local, lifted], dim=-1)
        out: Tensor = self.head(local)
        return out.transpose(0, 1)

    def _lift(self, v: Tensor) -> Tensor:
        extended = self.extension @ v.transpose(0, 1).flatten(1)
        return functional.gelu(self.lift(extended.view(-1, v.shape[0], v.shape[2])))


def u_shape_channels(width: int) -> tuple[int, ...]:
    """Return the channels of the seven layers: more on coarser grids."""
    return tuple(int(factor * width) for factor in (1.5, 2, 3, 4, 3, 2, 1))


def _layers(config: UnoConfig) -> list[OperatorLayer]:
    layers = []
    n_in, c_in = config.n_latent, config.lifting
    for i, (n_out, c_out, n_modes) in enumerate(
        zip(config.sizes, config.channels, config.modes, strict=True)
    ):
        joined = config.channels[SKIPS[i]] if config.skips and i in SKIPS else 0
        layers.append(
            OperatorLayer(
                in_channels=c_in + joined,
                out_channels=c_out,
                n_in=n_in,
                n_out=n_out,
                n_modes=n_modes,
            )
        )
        n_in, c_in = n_out, c_out
    return layers


# Sizes of the seven grids relative to the latent one; the fourth layer is the bottleneck.
U_SHAPE_RATIOS = (0.75, 0.5, 0.25, 0.25, 0.5, 0.75, 1.0)


class UnoSettings(Protocol):
    """The part of a training section of ``params.yaml`` that describes its operators."""

    @property
    def n_points(self) -> int:
        """Points of the grid on [0, 1]."""

    @property
    def period(self) -> float:
        """Period of the latent grid."""

    @property
    def width(self) -> int:
        """Channels of the lifted function."""

    @property
    def modes(self) -> list[int]:
        """Modes of the seven layers."""


def u_shape_config(settings: UnoSettings, in_channels: int, out_channels: int) -> UnoConfig:
    """Return the configuration of a U-NO of seven layers with skip connections."""
    return UnoConfig(
        in_channels=in_channels,
        out_channels=out_channels,
        lifting=settings.width,
        channels=u_shape_channels(settings.width),
        modes=tuple(settings.modes),
        ratios=U_SHAPE_RATIOS,
        n_points=settings.n_points,
        period=settings.period,
        skips=True,
    )


def uno_config_from_dict(facts: Mapping[str, Any]) -> UnoConfig:
    """Rebuild a configuration from ``dataclasses.asdict`` of one, through JSON or not."""
    tuples = {key: tuple(facts[key]) for key in ("channels", "modes", "ratios")}
    return UnoConfig(**{**facts, **tuples})
