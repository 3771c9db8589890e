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
    """One view of a clip: ``person_a`` is the partner, ``person_b`` the reaction.

    Parameters
    ----------
    label : of the view, such as ``real`` or ``oracle``
    interaction : both people
    """

    label: str
    interaction: Interaction


@dataclass(frozen=True)
class PlayedClip:
    """Panels that play side by side at the same time, in one world, with one camera.

    Parameters
    ----------
    name, action : shown as text; markup is escaped
    panels : at least one; the first determines the ground and the camera
    remark : reason why the clip is shown

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
        """Labels of the panels."""
        return [panel.label for panel in self.panels]

    def scenes(self) -> list[Scene]:
        """Return the panels as scenes of the player."""
        return [Scene.of(panel.label, panel.interaction) for panel in self.panels]


MEASUREMENT_COLUMNS = {
    "near_distance_error": Metric(
        "Near pairs", LOWER, "m", "change of the distances between near joints of the two people"
    ),
    "near_distance_error_naive": Metric(
        "Near pairs, scaled", UNKNOWN, "m", "the same if each body is only scaled"
    ),
    "far_distance_error": Metric("Far pairs", LOWER, "m", "the same for all other pairs"),
    "contacts_kept": Metric(
        "Contacts kept",
        HIGHER,
        "",
        "share of contacts over pairs and frames, strictly",
    ),
    "contacts_kept_with_slack": Metric("Within 12 cm", HIGHER, "", "the same within 12 cm"),
    "knee_change_p95": Metric("Knees", LOWER, "°", "95th percentile of the change of the angle"),
    "elbow_change_p95": Metric("Elbows", LOWER, "°", "the same of elbows"),
    "spine_change_p95": Metric("Spine", LOWER, "°", "the same within the spine"),
    "pelvis_height_error": Metric(
        "Pelvis", LOWER, "m", "mean error of its height, against the source's times the leg's scale"
    ),
    "trunk_change": Metric("Trunk", LOWER, "", "largest relative change of a distance within it"),
    "below_floor": Metric("Below the floor", LOWER, "m", "of the lowest joint"),
    "added_foot_skate": Metric(
        "Added foot skate", LOWER, "m/s", "of feet in stance, relative to the source"
    ),
    "capsule_penetration": Metric(
        "Penetration", LOWER, "m", "depth of the bodies in each other, beyond that of the source"
    ),
    "peak_acceleration_ratio": Metric(
        "Peak acceleration", LOWER, "", "largest acceleration over that of the source"
    ),
    "elbow_flips": Metric("Elbow flips", LOWER, "", "share of frames with an elbow bent backwards"),
}
KINDS = {
    "uniform": ("One body scaled", "all bones by one factor"),
    "single": ("One bone", "of the upper body"),
    "profile": ("One profile", "child, tall adult, long arms"),
    "random": ("Two sampled bodies", "log-normal stature and proportions"),
}


def variation_table(kinds: Mapping[str, Mapping[str, Mapping[str, float]]]) -> Table:
    """Return a table of each kind's measurements: means and percentiles."""
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
    name: str, source: Interaction, variations: Sequence[tuple[str, Mapping[str, Any], Interaction]]
) -> PlayedClip:
    """Return variations beside their source as a clip to play.

    Parameters
    ----------
    variations : label, measurements and motion of each, in order
    """
    panels = [
        Panel(f"{label}: {measurement_summary(measurements)}", interaction)
        for label, measurements, interaction in variations
    ]
    return PlayedClip(name, "", (Panel("source", source), *panels))


def measurement_summary(measurements: Mapping[str, float]) -> str:
    """Return the measurements of a variation in one line."""
    return (
        f"near distances changed by {1e3 * measurements['near_distance_error']:.1f} mm "
        f"({1e3 * measurements['near_distance_error_naive']:.0f} if only scaled), "
        f"contacts kept {100 * measurements['contacts_kept']:.1f} %, "
        f"knees changed by {measurements['knee_change_p95']:.0f}° at most "
        f"(95th percentile), elbows {measurements['elbow_change_p95']:.0f}°, "
        f"pelvis height off by {100 * measurements['pelvis_height_error']:.1f} cm, "
        f"foot skate {100 * measurements['added_foot_skate']:+.2f} cm/s, "
        f"penetration {100 * measurements['capsule_penetration']:.1f} cm, "
        f"below the floor {100 * measurements['below_floor']:.1f} cm"
    )
