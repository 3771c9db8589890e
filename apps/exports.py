"""A clip in other tools' formats, by the ending of the file."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.interaction import Interaction, Motion
from pacmo_core.figures.body import body_of
from pacmo_core.figures.film import check_gif_rate, find_ffmpeg, write_film
from pacmo_core.figures.flesh import flesh
from pacmo_core.figures.scenes import Scene
from pacmo_core.formats.base import MAX_DISTANCE, check_up
from pacmo_core.formats.fit_bones import ConstantBoneMotion, fit_bones
from pacmo_core.formats.resample import from_y_up, resample, sample_times
from pacmo_core.formats.write_bvh import format_bvh_of_fit
from pacmo_core.formats.write_gltf import (
    AnimatedPerson,
    gltf_document,
    rest_positions,
    to_glb,
    to_gltf,
)
from pacmo_core.formats.write_tables import format_csv, npz_bytes
from pacmo_core.project.workspace import CommandError
from pacmo_core.store.files import atomic_file, write_text

FILM_FPS = 25.0
COLOURS = ((0.0, 0.168, 0.445), (0.665, 0.112, 0.0))  # the viewer's blue and vermilion, linear
# glTF's own standard says metres, y up; a film shows no axis.
FIXED = (".glb", ".gltf", ".mp4", ".gif")


@dataclass(frozen=True)
class Form:
    """How to write: frames a second (None: as they are), the upward axis, metres a unit."""

    fps: float | None
    up: str
    unit: float

    def check(self, out: Path) -> None:
        """Refuse what a format cannot hold, before any work is done.

        Raises
        ------
        CommandError
            If the ending is none of ours, or the format fixes the axis and the unit.
        """
        ending = out.suffix.lower()
        if ending not in WRITERS:
            raise CommandError(f"{out}: wanted an ending of {', '.join(WRITERS)}")
        check_up(self.up)
        if not 0 < self.unit <= MAX_DISTANCE:
            raise CommandError(
                f"--unit must be > 0 and <= {MAX_DISTANCE:g} metres; got {self.unit}"
            )
        if ending in FIXED and (self.up, self.unit) != ("y", 1.0):
            raise CommandError(f"{out}: {ending} is always metres, y up; leave out --up and --unit")
        if ending == ".gif":
            check_gif_rate(self.fps or FILM_FPS)
        if ending == ".mp4":
            find_ffmpeg()


def export(scene: Scene, out: Path, form: Form) -> tuple[list[Path], str]:
    """Write each file whole or not at all; list them, and say what was lost."""
    ending = out.suffix.lower()
    fps = FILM_FPS if form.fps is None and ending in (".mp4", ".gif") else form.fps
    return WRITERS[ending](out, scene if fps is None else at_rate(scene, fps), form)


def at_rate(scene: Scene, fps: float) -> Scene:
    """Sample a scene anew."""
    at = sample_times(scene.times, fps)
    people = tuple(resample(motion, scene.times, at) for motion in scene.people)
    return replace(scene, times=at - at[0], people=people)


def _rate(scene: Scene) -> float:
    return float(1 / np.median(np.diff(scene.times)))


def _as_wanted(scene: Scene, form: Form) -> list[Motion]:
    return [(from_y_up(m, form.up) / form.unit).astype(np.float32) for m in scene.people]


def _bvh(out: Path, scene: Scene, form: Form) -> tuple[list[Path], str]:
    files, lost = [], []
    for person, motion in zip("AB", scene.people, strict=False):
        fitted = fit_bones(from_y_up(motion, form.up), scene.skeleton)
        lost.append(_off(fitted, from_y_up(motion, form.up), scene))
        in_units = replace(fitted, offsets=fitted.offsets / form.unit, root=fitted.root / form.unit)
        alone = len(scene.people) == 1
        files.append(out if alone else out.with_name(f"{out.stem}_{person}{out.suffix}"))
        write_text(files[-1], format_bvh_of_fit(in_units, _rate(scene), scene.skeleton))
    return files, _told(lost)


def _gltf(out: Path, scene: Scene, _: Form) -> tuple[list[Path], str]:
    actors, lost = [], []
    for person, motion, colour in zip("ab", scene.people, COLOURS, strict=False):
        fitted = fit_bones(motion, scene.skeleton)
        lost.append(_off(fitted, motion, scene))
        rest = rest_positions(fitted, scene.skeleton)
        skin = flesh(body_of(scene.skeleton), scene.skeleton, rest)
        actors.append(AnimatedPerson(person, fitted, skin, colour))
    document, data = gltf_document(scene.skeleton, scene.times, actors)
    write = to_glb if out.suffix.lower() == ".glb" else to_gltf
    _write_bytes(out, write(document, data))
    return [out], _told(lost)


def _csv(out: Path, scene: Scene, form: Form) -> tuple[list[Path], str]:
    write_text(out, format_csv(scene.skeleton, scene.times, _as_wanted(scene, form)))
    return [out], ""


def _npz(out: Path, scene: Scene, form: Form) -> tuple[list[Path], str]:
    people = _as_wanted(scene, form)
    content = npz_bytes(scene.skeleton, scene.times, people, up=form.up, unit=form.unit)
    _write_bytes(out, content)
    return [out], ""


def _film(out: Path, scene: Scene, form: Form) -> tuple[list[Path], str]:
    # Stills draw their first person orange; the viewer's first is blue.
    clip = Interaction(scene.skeleton, scene.times, scene.people[-1], scene.people[0])
    with atomic_file(out) as partial:
        # Writers go by the ending.
        named = partial.with_name(partial.name + out.suffix.lower())
        try:
            write_film(named, clip, form.fps or FILM_FPS)
            named.replace(partial)
        finally:
            named.unlink(missing_ok=True)
    return [out], ""


def _write_bytes(out: Path, content: bytes) -> None:
    with atomic_file(out) as partial:
        partial.write_bytes(content)


def _off(fitted: ConstantBoneMotion, motion: Motion, scene: Scene) -> NDArray[np.float64]:
    """``(T, J)`` metres between joints as they moved and as constant bones move them."""
    off: NDArray[np.float64] = np.linalg.norm(fitted.positions(scene.skeleton) - motion, axis=-1)
    return off


def _told(lost: list[NDArray[np.float64]]) -> str:
    off = 1000 * np.stack(lost)
    return f"constant bones moved joints by {off.mean():.1f} mm on average, {off.max():.1f} at most"


WRITERS: dict[str, Callable[[Path, Scene, Form], tuple[list[Path], str]]] = {
    ".bvh": _bvh,
    ".glb": _gltf,
    ".gltf": _gltf,
    ".csv": _csv,
    ".npz": _npz,
    ".mp4": _film,
    ".gif": _film,
}
