"""Clips made small enough to travel inside a page: 16-bit millimetres, base64."""

import base64
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pacmo_core.figures.body import body_of
from pacmo_core.interaction import Interaction, Motion

_MM = 1000.0
_FOOT_MM = 40.0  # the sole lies this far below the lowest joint
_TICKS_PER_S = 10_000  # times travel as whole tenths of a millisecond


@dataclass(frozen=True)
class Panel:
    """One picture of a clip: ``person_a`` is the partner, ``person_b`` the reaction.

    Parameters
    ----------
    label : what is shown, such as ``real`` or ``oracle``
    interaction : both people
    """

    label: str
    interaction: Interaction


@dataclass(frozen=True)
class PlayedClip:
    """Panels that play side by side on one clock, in one world, under one camera.

    Parameters
    ----------
    name, action : shown as they are, never run
    panels : at least one; the first sets the ground and the camera

    Raises
    ------
    ValueError
        If there is no panel.
    """

    name: str
    action: str
    panels: tuple[Panel, ...]

    def __post_init__(self) -> None:
        if not self.panels:
            raise ValueError(f"clip {self.name!r}: wanted at least one panel; got none")


def pack(motion: Motion, origin: NDArray[np.float64]) -> str:
    """Write a motion as whole millimetres from ``origin``: half a millimetre off at worst.

    Parameters
    ----------
    motion : (T, J, 3) float32, metres
    origin : (3,) float64, metres

    Returns
    -------
    Base64 of little-endian int16, in the order of the array.

    Raises
    ------
    ValueError
        If a joint is more than 32.767 m from the origin along an axis.
    """
    millimetres = np.rint((motion - origin) * _MM)
    farthest = np.abs(millimetres).max()
    if farthest > np.iinfo(np.int16).max:
        raise ValueError(
            f"a played motion must stay within 32.767 m of its origin; got {farthest / _MM:.1f} m"
        )
    return base64.b64encode(millimetres.astype("<i2").tobytes()).decode()


def packed_clip(clip: PlayedClip) -> dict[str, Any]:
    """Turn a clip into what the player reads, ready for JSON."""
    first = clip.panels[0].interaction
    origin = np.rint(_everyone(first).mean(axis=(0, 1)) * _MM) / _MM
    return {
        "origin": origin.tolist(),
        "view": _view(first, origin),
        "panels": [_packed_panel(panel, origin) for panel in clip.panels],
    }


def _packed_panel(panel: Panel, origin: NDArray[np.float64]) -> dict[str, Any]:
    shown = panel.interaction
    ticks = np.rint((shown.times - shown.times[0]) * _TICKS_PER_S).astype("<i4")
    return {
        "joints": len(shown.skeleton.joints),
        "body": asdict(body_of(shown.skeleton)),
        "ticks": base64.b64encode(ticks.tobytes()).decode(),
        "partner": pack(shown.person_a, origin),
        "reaction": pack(shown.person_b, origin),
    }


def _everyone(shown: Interaction) -> NDArray[np.float32]:
    """``(T, 2J, 3)`` metres: the joints of both people."""
    return np.concatenate([shown.person_a, shown.person_b], axis=1)


def _view(shown: Interaction, origin: NDArray[np.float64]) -> dict[str, float]:
    """Place the ground and a camera that sees both people from the side, whole; millimetres.

    The ground is the median over frames of the lowest joint: a depth camera that leans, or
    loses a foot, leaves single frames far below the floor.
    """
    away = (_everyone(shown) - origin) * _MM
    apart = (shown.person_b - shown.person_a).mean(axis=(0, 1))
    return {
        "ground": round(float(np.median(away[..., 1].min(axis=1))) - _FOOT_MM, 1),
        "top": round(float(np.percentile(away[..., 1].max(axis=1), 95)), 1),
        "reach": round(float(np.percentile(np.hypot(away[..., 0], away[..., 2]), 99)), 1),
        "yaw": round(float(-np.arctan2(apart[2], apart[0])), 4),
    }
