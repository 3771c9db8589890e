"""Variations beside their source, and the table of how good they are."""

from collections.abc import Mapping, Sequence
from typing import Any

from pacmo_core.data.interaction import Interaction
from pacmo_core.figures.clips import Panel, PlayedClip
from pacmo_core.figures.columns import HIGHER, LOWER, UNKNOWN, Metric
from pacmo_core.figures.tables import Line, Table, entry_of

COLUMNS = {
    "near_distance_error": Metric(
        "Near pairs", LOWER, "m", "change of the distances between joints of the two that are near"
    ),
    "near_distance_error_naive": Metric(
        "scaled in place", UNKNOWN, "m", "the same, each body for itself"
    ),
    "far_distance_error": Metric("Far pairs", LOWER, "m", "the same of all other pairs"),
    "contacts_preserved": Metric("Contacts kept", HIGHER, "", "share of touching pairs and frames"),
    "added_foot_skate": Metric(
        "Added sliding", LOWER, "m/s", "of standing feet, over the source's"
    ),
    "penetration": Metric("Deeper", LOWER, "m", "how much closer than in the source, at worst"),
    "acceleration_peak_ratio": Metric(
        "Seam ratio", LOWER, "", "sharpest jolt over the motion around it"
    ),
    "bend_flip_fraction": Metric(
        "Flips", LOWER, "", "share of frames with an elbow or knee bent back"
    ),
    "trunk_deformation": Metric(
        "Trunk bent", LOWER, "", "share by which two joints of a trunk are nearer than they should"
    ),
}
KINDS = {
    "uniform": ("One body grown or shrunk", "all bones alike"),
    "single": ("One bone", "of the upper body"),
    "profile": ("A given body", "child, tall adult, long arms"),
    "random": ("Two drawn bodies", "log-normal stature and proportions"),
}


def variation_table(kinds: Mapping[str, Mapping[str, Mapping[str, float]]]) -> Table:
    """Lay out each kind's figures: the mean, and between which values most lie."""
    return Table(
        metrics=tuple(COLUMNS.values()),
        lines=tuple(
            Line(
                *KINDS[kind],
                is_model=False,
                entries=tuple(entry_of(kinds[kind].get(name, {}), "") for name in COLUMNS),
            )
            for kind in KINDS
            if kind in kinds
        ),
    )


def varied_clip(
    name: str, source: Interaction, shown: Sequence[tuple[str, Mapping[str, Any], Interaction]]
) -> PlayedClip:
    """Set variations beside their source.

    Parameters
    ----------
    shown : label, figures and motion of each variation, in order
    """
    panels = [
        Panel(f"{label}: {said(figures)}", interaction) for label, figures, interaction in shown
    ]
    return PlayedClip(name, "", (Panel("source", source), *panels))


def said(figures: Mapping[str, float]) -> str:
    """Say a variation's figures in a line."""
    return (
        f"near pairs {1e3 * figures['near_distance_error']:.1f} mm off "
        f"({1e3 * figures['near_distance_error_naive']:.0f} if scaled in place), "
        f"contacts {100 * figures['contacts_preserved']:.1f} %, "
        f"sliding {100 * figures['added_foot_skate']:+.2f} cm/s, "
        f"{1e3 * figures['penetration']:.1f} mm deeper, seam {figures['acceleration_peak_ratio']:.2f}, "
        f"trunk bent {100 * figures['trunk_deformation']:.0f} %"
    )
