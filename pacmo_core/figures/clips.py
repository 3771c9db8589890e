"""Clips that a report plays: panels side by side."""

from dataclasses import dataclass

from pacmo_core.data.interaction import Interaction
from pacmo_core.figures.tables import Table
from pacmo_core.figures.viewer import Scene


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
    captions : label of a panel and the rest of a sentence about it
    table : of measurements, below the player

    Raises
    ------
    ValueError
        If there is no panel.
    """

    name: str
    action: str
    panels: tuple[Panel, ...]
    remark: str = ""
    captions: tuple[tuple[str, str], ...] = ()
    table: Table | None = None

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
