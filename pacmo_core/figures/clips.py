"""Clips that a report plays: panels side by side, partner and reaction in each."""

from dataclasses import dataclass

from pacmo_core.data.interaction import Interaction
from pacmo_core.figures.scenes import Scene


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
