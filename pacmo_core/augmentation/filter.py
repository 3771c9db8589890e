"""Selects the clips that are varied, and accepts variations by limits on their measurements."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from math import inf, isnan

from pacmo_core.data.interaction import Interaction, joint_distances
from pacmo_core.interaction_mesh.report import LOWER_LIMITS, limit_ratio


@dataclass(frozen=True)
class Candidate:
    """A clip that may be varied.

    Parameters
    ----------
    clip, sequence, action : as in its record
    near_pairs : mean number of near joint pairs per frame (``mean_near_pairs``)
    """

    clip: str
    sequence: str
    action: str
    near_pairs: float


def mean_near_pairs(interaction: Interaction, near_distance: float) -> float:
    """Count pairs of joints of the two people closer than a distance in metres: mean per frame."""
    near = joint_distances(interaction) < near_distance
    return float(near.sum() / len(interaction.times))


def select_clips(
    candidates: Sequence[Candidate], *, max_per_sequence: int | None, max_clips: int | None
) -> list[str]:
    """Select the clips with the most near joint pairs, balanced over sequences and actions.

    At most ``max_per_sequence`` clips of each sequence; of these at most ``max_clips``, one of
    each action before a second of any. None means no limit.

    Returns
    -------
    names, sorted
    """
    ranked = sorted(candidates, key=lambda c: (-c.near_pairs, c.clip))
    ranks_in_sequence = _occurrence_index([c.sequence for c in ranked])
    selected = [
        candidate
        for candidate, rank in zip(ranked, ranks_in_sequence, strict=True)
        if max_per_sequence is None or rank < max_per_sequence
    ]
    ranks_in_action = _occurrence_index([c.action for c in selected])
    order = sorted(range(len(selected)), key=lambda i: (ranks_in_action[i], i))
    return sorted(selected[i].clip for i in order[:max_clips])


def _occurrence_index(names: Sequence[str]) -> list[int]:
    """Count for each name how often it occurs before."""
    counts: dict[str, int] = {}
    indices = []
    for name in names:
        indices.append(counts.get(name, 0))
        counts[name] = indices[-1] + 1
    return indices


@dataclass(frozen=True, kw_only=True)
class VariationLimits:
    """Limits on the measurements of an accepted variation.

    See ``interaction_mesh.Report`` for the measurements. All are upper limits, but for
    ``contacts_kept``, which is a lower limit.
    """

    primal_residual: float
    contacts_kept: float
    capsule_penetration: float
    knee_change_p95: float
    elbow_change_p95: float
    spine_change_p95: float
    spine_bend: float
    pelvis_height_error: float
    support_height_error: float
    trunk_change: float
    below_floor: float
    added_foot_skate: float
    peak_acceleration_ratio: float
    seam_ratio: float
    knee_flips: float
    elbow_flips: float


def exceeded_limits(measurements: Mapping[str, float], limits: VariationLimits) -> dict[str, float]:
    """List the measurements out of their limits, with their ratio to the limit.

    Empty for an accepted variation. NaN is out of every limit.
    """
    ratios = {
        name: limit_ratio(name, measurements[name], limit) for name, limit in asdict(limits).items()
    }
    return {name: ratio for name, ratio in ratios.items() if not ratio <= 1}


def max_limit_ratio(measurements: Mapping[str, float], limits: VariationLimits) -> float:
    """Return the largest ratio of a measurement to its limit; infinity if a measurement is NaN."""
    ratios = [
        limit_ratio(name, measurements[name], limit) for name, limit in asdict(limits).items()
    ]
    return max(inf if isnan(ratio) else ratio for ratio in ratios)


def rejection_reason(measurements: Mapping[str, float], limits: VariationLimits) -> str:
    """Describe the exceeded limits, largest ratio first; empty for an accepted variation."""
    exceeded = exceeded_limits(measurements, limits)
    parts = []
    for name in sorted(exceeded, key=lambda n: -exceeded[n]):
        bound = "at least" if name in LOWER_LIMITS else "at most"
        parts.append(f"{name} {measurements[name]:.3g}, wanted {bound} {asdict(limits)[name]:g}")
    return "; ".join(parts)
