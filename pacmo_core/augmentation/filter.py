"""Which clips are varied: those in which the two are nearest, of as many acts as there are."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from math import inf, isnan

from pacmo_core.data.interaction import Interaction, joint_distances


@dataclass(frozen=True)
class Candidate:
    """A clip that may be varied.

    Parameters
    ----------
    clip, sequence, action : as in its facts
    nearness : of the two people; see ``nearness_of``
    """

    clip: str
    sequence: str
    action: str
    nearness: float


def mean_near_pairs(interaction: Interaction, near: float) -> float:
    """Count pairs of joints, one of either person, nearer than ``near`` metres: mean of frames."""
    return float((joint_distances(interaction) < near).sum() / len(interaction.times))


def select_clips(
    candidates: Sequence[Candidate], *, of_each_sequence: int | None, most: int | None
) -> list[str]:
    """Choose clips: the nearest of each sequence, and of these one an act before a second of any.

    Parameters
    ----------
    of_each_sequence, most : at most; None for all

    Returns
    -------
    names, sorted
    """
    nearest = sorted(candidates, key=lambda c: (-c.nearness, c.clip))
    first = _occurrence_index([c.sequence for c in nearest])
    kept = [
        candidate
        for candidate, turn in zip(nearest, first, strict=True)
        if of_each_sequence is None or turn < of_each_sequence
    ]
    turns = _occurrence_index([c.action for c in kept])
    order = sorted(range(len(kept)), key=lambda i: (turns[i], i))
    return sorted(kept[i].clip for i in order[:most])


def _occurrence_index(names: Sequence[str]) -> list[int]:
    """Say how often each name was named before."""
    seen: dict[str, int] = {}
    turns = []
    for name in names:
        turns.append(seen.get(name, 0))
        seen[name] = turns[-1] + 1
    return turns


# FROM """Which variations are good enough to train on."""
# Figures of which more is better; of all others less is.
LOWER_LIMITS = ("contacts_kept",)


@dataclass(frozen=True, kw_only=True)
class VariationLimits:
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


def exceeded_limits(figures: Mapping[str, float], bounds: VariationLimits) -> dict[str, float]:
    """List what is out of bounds, and by how many times: empty where a variation is good.

    A figure that is no number is out of bounds.
    """
    found = {}
    for name, bound in asdict(bounds).items():
        share = limit_ratio(name, figures[name], bound)
        if not share <= 1:
            found[name] = share
    return found


def limit_ratio(name: str, figure: float, bound: float) -> float:
    """Give a figure as a share of its bound: good up to 1."""
    share, allowed = (1 - figure, 1 - bound) if name in LOWER_LIMITS else (figure, bound)
    if allowed:
        return share / allowed
    return inf if share > 0 else 0.0


def max_limit_ratio(figures: Mapping[str, float], bounds: VariationLimits) -> float:
    """Give the worst figure as a share of its bound; no number counts as the very worst."""
    shares = [limit_ratio(name, figures[name], bound) for name, bound in asdict(bounds).items()]
    return max(inf if isnan(share) else share for share in shares)


def rejection_reason(figures: Mapping[str, float], bounds: VariationLimits) -> str:
    """Say what is out of bounds, the worst first; empty where nothing is."""
    found = exceeded_limits(figures, bounds)
    said = []
    for name in sorted(found, key=lambda n: -found[n]):
        wanted = "at least" if name in LOWER_LIMITS else "at most"
        said.append(f"{name} {figures[name]:.3g}, wanted {wanted} {asdict(bounds)[name]:g}")
    return "; ".join(said)
