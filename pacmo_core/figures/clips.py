"""Clips that a report plays: panels side by side, and variations beside their source."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pacmo_core.data.interaction import Interaction
from pacmo_core.figures.tables import Line, Table, make_entry
from pacmo_core.figures.viewer import Scene
from pacmo_core.metrics.catalogue import HIGHER, LOWER, UNKNOWN, Metric


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
    remark : why it is shown

    Raises
    ------
    ValueError
        If there is no panel.
    """

    name: str
    action: str
    panels: tuple[Panel, ...]
    remark: str = ""

    def __post_init__(self) -> None:
        if not self.panels:
            raise ValueError(f"clip {self.name!r}: wanted at least one panel; got none")

    @property
    def labels(self) -> list[str]:
        """What each panel shows."""
        return [panel.label for panel in self.panels]

    def scenes(self) -> list[Scene]:
        """Give the panels to the player."""
        return [Scene.of(panel.label, panel.interaction) for panel in self.panels]


MEASUREMENT_COLUMNS = {
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
        metrics=tuple(MEASUREMENT_COLUMNS.values()),
        lines=tuple(
            Line(
                *KINDS[kind],
                is_model=False,
                entries=tuple(
                    make_entry(kinds[kind].get(name, {}), "") for name in MEASUREMENT_COLUMNS
                ),
            )
            for kind in KINDS
            if kind in kinds
        ),
    )


def played_variation(
    name: str, source: Interaction, shown: Sequence[tuple[str, Mapping[str, Any], Interaction]]
) -> PlayedClip:
    """Set variations beside their source.

    Parameters
    ----------
    shown : label, figures and motion of each variation, in order
    """
    panels = [
        Panel(f"{label}: {measurement_summary(figures)}", interaction)
        for label, figures, interaction in shown
    ]
    return PlayedClip(name, "", (Panel("source", source), *panels))


def measurement_summary(figures: Mapping[str, float]) -> str:
    """Say a variation's figures in a line."""
    return (
        f"near pairs {1e3 * figures['near_distance_error']:.1f} mm off "
        f"({1e3 * figures['near_distance_error_naive']:.0f} if scaled in place), "
        f"contacts {100 * figures['contacts_preserved']:.1f} %, "
        f"sliding {100 * figures['added_foot_skate']:+.2f} cm/s, "
        f"{1e3 * figures['penetration']:.1f} mm deeper, "
        f"seam {figures['acceleration_peak_ratio']:.2f}, "
        f"trunk bent {100 * figures['trunk_deformation']:.0f} %"
    )
