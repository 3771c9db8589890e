"""The viewer: one page that plays clips in 3-D, without a network or a server."""

import base64
import hashlib
from collections.abc import Sequence
from importlib.resources import files

from jinja2 import Environment, FunctionLoader, StrictUndefined
from markupsafe import Markup

from pacmo_core.figures.scenes import Scene, packed_scenes

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
MOST = 6  # clips side by side: more are too small to judge


def render_viewer(scenes: Sequence[Scene], *, contact: float) -> str:
    """Write a page that plays scenes side by side and refers to nothing outside itself.

    Equal scenes give equal bytes. Every text is escaped; the page's own policy lets no script
    run but the library and the player, by their hashes.

    Parameters
    ----------
    scenes : one to six
    contact : metres between joints of two people that touch

    Raises
    ------
    ValueError
        If there are none, or too many.
    """
    if not 1 <= len(scenes) <= MOST:
        raise ValueError(f"a page shows 1 to {MOST} clips side by side; got {len(scenes)}")
    library, script = player_scripts()
    return (
        environment()
        .get_template("viewer.html")
        .render(
            title=" · ".join(scene.label for scene in scenes),
            labels=[scene.label for scene in scenes],
            people=max(len(scene.people) for scene in scenes),
            packed=[packed_scenes(scenes, contact=contact)],
            style=Markup(part("player.css") + part("viewer.css")),
            scripts=[Markup(library), Markup(script)],
            hashes=[script_hash(library), script_hash(script)],
        )
    )


def player_scripts() -> tuple[str, str]:
    """Give the library and the player, as they stand in a page."""
    return part(LIBRARY), "\n".join(part(name) for name in SCRIPTS)


def script_hash(script: str) -> str:
    """Name a script as a content security policy does."""
    return "sha256-" + base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()


def part(name: str) -> str:
    """Read a file that stands beside this one."""
    return files("pacmo_core.figures").joinpath(name).read_text(encoding="utf-8")


def environment() -> Environment:
    """Read templates from beside this file; escape all that is not marked as safe."""
    return Environment(
        loader=FunctionLoader(part),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
