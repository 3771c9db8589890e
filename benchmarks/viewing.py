"""Script time of a frame of the viewer: four clips of two people, with all overlays.

Usage: python -m benchmarks.viewing [--json]

Drawing itself is done by the graphics card; without one it is done in software. WebGL calls that
draw are therefore replaced by empty functions; everything else runs as in a page that plays, in
headless Chromium.
``script_ms`` is the median of 500 frames; 60 fps leave 16.7 ms. The slowest frames wait
for the software compositor of the browser, which a machine with a graphics card does not use.
"""

import tempfile
from pathlib import Path

import numpy as np

from benchmarks._figures import arguments, show
from pacmo_core.data.interaction import Interaction
from pacmo_core.figures.viewer import Scene, render_viewer
from pacmo_core.synthesis import ACTIONS, sample_interaction, sample_scripts
from tests.figures.browser import open_page

FRAMES = """(() => {
  const player = Pacmo.players[0], costs = [];
  for (const name of ["trails", "distances", "contacts", "names"]) player.set(name, true);
  for (const call of ["drawElements", "drawElementsInstanced", "drawArrays", "clear"])
    WebGL2RenderingContext.prototype[call] = () => {};
  for (let frame = 0; frame < 600; frame += 1) {
    player.time = (frame / 60) % player.length;
    const start = performance.now();
    player.draw();
    player.say();
    costs.push(performance.now() - start);
  }
  return costs.slice(100);
})()"""


def clips() -> list[Scene]:
    """Return four synthetic clips of two people, two at 30 and two at 120 fps."""
    scripts = sample_scripts(4, population=1, pairs=1, actions=tuple(ACTIONS)[:4], replications=1)
    seen = [sample_interaction(script, random) for script, random in scripts]
    finer = [*seen[:2], *map(four_times, seen[2:])]
    return [Scene.of(f"{k}, {clip.fps:.0f} fps", clip) for k, clip in enumerate(finer)]


def four_times(clip: Interaction) -> Interaction:
    """Insert three linearly interpolated frames between any two."""
    at = np.arange(4 * len(clip.times) - 3)
    low, share = np.minimum(at // 4, len(clip.times) - 2), (at - 4 * (at // 4)) / 4.0
    share = np.where(at // 4 > low, 1.0, share)

    def between(values: np.ndarray) -> np.ndarray:
        weight = share.reshape(-1, *[1] * (values.ndim - 1))
        mixed: np.ndarray = values[low] * (1 - weight) + values[low + 1] * weight
        return mixed.astype(values.dtype)

    return Interaction(
        clip.skeleton, between(clip.times), between(clip.person_a), between(clip.person_b)
    )


def main() -> None:
    """Measure and print."""
    given = arguments(__doc__ or "").parse_args()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name:
        page = Path(name) / "view.html"
        size = page.write_text(render_viewer(clips(), contact=0.1), encoding="utf-8")
        with open_page(page, Path(name) / "profile") as tab:
            tab.wait_until("Pacmo.players[0].renderer && Pacmo.players[0].boxes")
            costs = np.array(tab.run(FRAMES))
    figures = {"script_ms": float(np.median(costs)), "page_kb": size / 1e3}
    show(figures, as_json=given.json)


if __name__ == "__main__":
    main()
