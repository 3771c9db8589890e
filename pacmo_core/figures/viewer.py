"""The 3-D viewer: one page that plays clips without a network or a server.

Positions are stored in the page as 16-bit multiples of a step from an origin, in base64.
"""

import base64
import hashlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from importlib.resources import files
from typing import Any

import numpy as np
from jinja2 import Environment, FunctionLoader, StrictUndefined
from markupsafe import Markup
from numpy.typing import NDArray

from pacmo_core.data.interaction import Interaction, Motion
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.data.transforms import line_between
from pacmo_core.figures.body_shape import make_body_shape
from pacmo_core.figures.tables import Table

_MAX_STEP = np.iinfo(np.int16).max
_SOLE_HEIGHT = 0.04  # metres from the ground to the lowest joint
_HEAD_MARGIN = 0.12  # metres from the joint of the head to its top
_SAME_WORLD_DISTANCE = (
    0.05  # metres between first root positions above which two scenes are of different worlds
)
_SMOOTHING_SECONDS = 0.5  # seconds before and after over which the following camera averages


@dataclass(frozen=True)
class Scene:
    """A clip for display: one or two people.

    Parameters
    ----------
    label : such as the name of the clip; markup is escaped
    skeleton : of all people
    times : (T,) float64, seconds, increasing
    people : one or two of (T, J, 3) float32, metres, y up, finite
    other : skeleton of the second person, if it is another one

    Raises
    ------
    ValueError
        If there are not one or two people, or a motion has another shape.
    """

    label: str
    skeleton: Skeleton
    times: NDArray[np.float64]
    people: tuple[Motion, ...]
    other: Skeleton | None = None

    def __post_init__(self) -> None:
        wanted = [(len(self.times), len(body.joints), 3) for body in self.skeletons]
        shapes = [motion.shape for motion in self.people]
        if len(shapes) not in (1, 2) or shapes != wanted:
            raise ValueError(f"scene {self.label!r}: wanted one or two of {wanted}; got {shapes}")

    @property
    def skeletons(self) -> list[Skeleton]:
        """The skeleton of each person."""
        return [self.skeleton, self.other or self.skeleton][: len(self.people)]

    @property
    def roots(self) -> list[Motion]:
        """(T, 3) metres of each person."""
        return [m[:, body.root] for m, body in zip(self.people, self.skeletons, strict=True)]

    @property
    def positions(self) -> NDArray[np.float64]:
        """``(T, P J, 3)`` metres: the joints of all people."""
        return np.concatenate(self.people, axis=1).astype(np.float64)

    @property
    def yaw(self) -> float:
        """Radians about +y of a camera that sees two people side by side, the first on the left."""
        return line_between(*self.roots) if len(self.people) == 2 else 0.0

    @staticmethod
    def of(label: str, interaction: Interaction) -> "Scene":
        """Return a scene of both people of an interaction."""
        people = (interaction.person_a, interaction.person_b)
        return Scene(label, interaction.skeleton, interaction.times, people)


def pack_motion(motion: Motion, origin: NDArray[np.float64], step: float) -> str:
    """Encode a motion as integer steps from ``origin``; the error is at most half a step per axis.

    Returns
    -------
    Base64 of little-endian int16, in the order of the array.
    """
    return base64.b64encode(np.rint((motion - origin) / step).astype("<i2").tobytes()).decode()


def packed_scenes(scenes: Sequence[Scene], *, contact: float) -> list[dict[str, Any]]:
    """Return scenes as JSON values for the player.

    Scenes of one world, such as a capture and reactions in it, share ground and camera.

    Parameters
    ----------
    contact : distance in metres below which joints of two people are marked as in contact
    """
    views: list[dict[str, Any]] = []
    for number, scene in enumerate(scenes):
        known = [k for k in range(number) if _same_world(scenes[k], scene)]
        world = [other for other in scenes if _same_world(other, scene)]
        views.append(views[known[0]] if known else _camera(world))
    return [
        _pack_scene(scene, contact) | {"view": view}
        for scene, view in zip(scenes, views, strict=True)
    ]


def _pack_scene(scene: Scene, contact: float) -> dict[str, Any]:
    everyone = scene.positions
    low, high = everyone.min(axis=(0, 1)), everyone.max(axis=(0, 1))
    origin = (low + high) / 2
    step = max(float((high - low).max()) / 2 / _MAX_STEP, 1e-6)
    return {
        "label": scene.label,
        **_pack_skeleton(scene.skeleton),
        **({"other": _pack_skeleton(scene.other)} if scene.other else {}),
        "contact": contact,
        "times": base64.b64encode((scene.times - scene.times[0]).astype("<f8").tobytes()).decode(),
        "origin": origin.tolist(),
        "step": step,
        "motions": [pack_motion(motion, origin, step) for motion in scene.people],
    }


def _pack_skeleton(skeleton: Skeleton) -> dict[str, Any]:
    return {
        "joints": skeleton.joints,
        "parents": skeleton.parents,
        "root": skeleton.root,
        "body": asdict(make_body_shape(skeleton)),
    }


def _camera(world: Sequence[Scene]) -> dict[str, Any]:
    """Return the ground height, the extent of the motion, and the yaw that shows two side by side.

    The ground is the median over frames of the lowest joint: a tilted depth camera, or a foot
    that it loses, gives single frames far below the floor.
    """
    everyone = [scene.positions for scene in world]
    flat = [people[..., [0, 2]] for people in everyone]
    low, high = np.percentile(np.concatenate([f.reshape(-1, 2) for f in flat]), [1, 99], axis=0)
    centre = (low + high) / 2
    near = [f - _camera_path(scene)[:, None] for f, scene in zip(flat, world, strict=True)]
    return {
        "centre": centre.round(4).tolist(),
        "ground": round(float(np.median(everyone[0][..., 1].min(axis=1))) - _SOLE_HEIGHT, 4),
        "top": round(max(map(_top, everyone)) + _HEAD_MARGIN, 4),
        "reach": max(_radius_of_view(f - centre) for f in flat),
        "near": max(map(_radius_of_view, near)),
        "yaw": round(world[0].yaw, 4),
    }


def _top(everyone: NDArray[np.float64]) -> float:
    return float(np.percentile(everyone[..., 1].max(axis=1), 95))


def _radius_of_view(offsets: NDArray[np.float64]) -> float:
    return round(float(np.percentile(np.linalg.norm(offsets, axis=-1), 99)), 4)


def _camera_path(scene: Scene) -> NDArray[np.float64]:
    """Return ``(T, 2)`` metres on the ground: the mean of all roots, averaged over a second."""
    roots = np.stack(scene.roots)[..., [0, 2]]
    sums = np.concatenate([np.zeros((1, 2)), roots.mean(axis=0, dtype=np.float64).cumsum(axis=0)])
    first = np.searchsorted(scene.times, scene.times - _SMOOTHING_SECONDS)
    last = np.searchsorted(scene.times, scene.times + _SMOOTHING_SECONDS, side="right")
    path: NDArray[np.float64] = (sums[last] - sums[first]) / (last - first)[:, None]
    return path


def _same_world(first: Scene, second: Scene) -> bool:
    return any(
        np.linalg.norm(p[0] - q[0]) < _SAME_WORLD_DISTANCE
        for p in first.roots
        for q in second.roots
    )


STYLES = ("player.css", "table.css", "viewer.css")
LIBRARY = "three.min.js"
SCRIPTS = (
    "view_motion.js",
    "view_body.js",
    "view_stage.js",
    "view_overlay.js",
    "view_plot.js",
    "view_hands.js",
    "view_controls.js",
    "view_player.js",
)
MAX_CLIPS = 6  # clips side by side: more are too small to judge


def render_viewer(
    scenes: Sequence[Scene], *, contact: float, title: str = "", table: Table | None = None
) -> str:
    """Return a self-contained page that plays scenes side by side.

    Equal scenes give equal bytes. Every text is escaped; the content security policy of the page
    allows only the library and the player, by their hashes.

    Parameters
    ----------
    scenes : one to six
    contact : distance in metres below which joints of two people are marked as in contact
    title : of the page; default: the labels
    table : of measurements, below the clips

    Raises
    ------
    ValueError
        If there are none, or too many.
    """
    if not 1 <= len(scenes) <= MAX_CLIPS:
        raise ValueError(f"a page shows 1 to {MAX_CLIPS} clips side by side; got {len(scenes)}")
    library, script = player_scripts()
    return (
        template_environment()
        .get_template("viewer.html")
        .render(
            title=title or " · ".join(scene.label for scene in scenes),
            table=table,
            labels=[scene.label for scene in scenes],
            people=max(len(scene.people) for scene in scenes),
            packed=[packed_scenes(scenes, contact=contact)],
            style=Markup("".join(map(read_asset, STYLES))),
            scripts=[Markup(library), Markup(script)],
            hashes=[script_hash(library), script_hash(script)],
        )
    )


def player_scripts() -> tuple[str, str]:
    """Return the scripts of the library and of the player."""
    return read_asset(LIBRARY), "\n".join(read_asset(name) for name in SCRIPTS)


def script_hash(script: str) -> str:
    """Return the hash of a script as in a content security policy."""
    return "sha256-" + base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()


def read_asset(name: str) -> str:
    """Read a file in the folder of this module."""
    return files("pacmo_core.figures").joinpath(name).read_text(encoding="utf-8")


def template_environment() -> Environment:
    """Return an environment of the templates in this folder, with automatic escaping."""
    return Environment(
        loader=FunctionLoader(read_asset),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


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
