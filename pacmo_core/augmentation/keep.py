"""Which variations are good enough to train on."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from math import inf, isnan

# Figures of which more is better; of all others less is.
LEAST = ("contacts_kept",)


@dataclass(frozen=True, kw_only=True)
class Bounds:
    """What a variation's figures keep within; see ``interaction_mesh.Report`` and ``shape``.

    Parameters
    ----------
    raw_residual, added_slide, penetration, seam_ratio, flip_share, trunk_change : at most
    contacts_kept : at least
    """

    raw_residual: float
    contacts_kept: float
    added_slide: float
    penetration: float
    seam_ratio: float
    flip_share: float
    trunk_change: float


def excess(figures: Mapping[str, float], bounds: Bounds) -> dict[str, float]:
    """List what is out of bounds, and by how many times: empty where a variation is good.

    A figure that is no number is out of bounds.
    """
    found = {}
    for name, bound in asdict(bounds).items():
        share = badness(name, figures[name], bound)
        if not share <= 1:
            found[name] = share
    return found


def badness(name: str, figure: float, bound: float) -> float:
    """Give a figure as a share of its bound: good up to 1."""
    share, allowed = (1 - figure, 1 - bound) if name in LEAST else (figure, bound)
    if allowed:
        return share / allowed
    return inf if share > 0 else 0.0


def worst(figures: Mapping[str, float], bounds: Bounds) -> float:
    """Give the worst figure as a share of its bound; no number counts as the very worst."""
    shares = [badness(name, figures[name], bound) for name, bound in asdict(bounds).items()]
    return max(inf if isnan(share) else share for share in shares)


def reason_of(figures: Mapping[str, float], bounds: Bounds) -> str:
    """Say what is out of bounds, the worst first; empty where nothing is."""
    found = excess(figures, bounds)
    said = []
    for name in sorted(found, key=lambda n: -found[n]):
        wanted = "at least" if name in LEAST else "at most"
        said.append(f"{name} {figures[name]:.3g}, wanted {wanted} {asdict(bounds)[name]:g}")
    return "; ".join(said)
