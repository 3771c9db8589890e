"""Truth: what Pillow reads back; what ffmpeg, where there is one, says of its file."""

import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pacmo_core.figures import stills
from pacmo_core.figures.stills import (
    ASPECT,
    check_gif_rate,
    choose_camera,
    find_ffmpeg,
    follow_people,
    project,
    write_film,
)
from pacmo_core.figures.viewer import Scene
from tests.figures.samples import interaction

CLIP = Scene.of("", interaction(1, n_frames=5, fps=25.0))


def test_the_picture_of_a_film_follows_both_people_smoothly_and_shows_them_completely() -> None:
    clip = interaction(2, n_frames=100, fps=25.0)
    # They walk 10 m, and one of them 2 m away from the other and back.
    walk = np.linspace(0, 10, 100)[:, None, None] * np.array([1.0, 0, 0])
    apart = np.sin(np.linspace(0, np.pi, 100))[:, None, None] * np.array([0.5, 0, 2.0])
    a, b = (clip.person_a + walk, clip.person_b + walk + apart)
    clip = replace(clip, person_a=a.astype(np.float32), person_b=b.astype(np.float32))
    scene = Scene.of("", clip)
    camera = choose_camera(scene)
    boxes = follow_people(scene, camera, 1.9)
    flat = project(scene.positions, camera)[..., :2]
    corners = np.array([[[box.left, box.bottom],
                         [box.left + box.width, box.bottom + ASPECT * box.width]]
                        for box in boxes])  # fmt: skip
    assert (flat.min(axis=1) >= corners[:, 0]).all() and (flat.max(axis=1) <= corners[:, 1]).all()
    widths = np.ptp(corners, axis=1)[:, 0]
    assert widths.max() < 0.5 * np.ptp(flat[..., 0]), "not of the whole walk"
    steps = np.abs(np.diff(corners, n=2, axis=0)).max()
    assert steps < 0.02, "metres: the picture does not jerk"


def test_a_gif_has_a_frame_a_frame_that_lasts_as_long_and_loops(tmp_path: Path) -> None:
    write_film(tmp_path / "clip.gif", CLIP, 25)
    with Image.open(tmp_path / "clip.gif") as found:
        assert (found.n_frames, found.info["duration"], found.info["loop"]) == (5, 40, 0)
        first = np.asarray(found.convert("RGB"), float)
        found.seek(4)
        assert np.abs(np.asarray(found.convert("RGB"), float) - first).max() > 50


@pytest.mark.parametrize("fps", [50, 100 / 3, 25, 20, 12.5, 10, 1])
def test_rates_of_whole_hundredths_are_a_gifs(fps: float) -> None:
    check_gif_rate(fps)


@pytest.mark.parametrize("fps", [30, 60, 100, 24])
def test_other_rates_are_refused_with_those_that_go(fps: float) -> None:
    with pytest.raises(ValueError, match=f"33.333.*got {fps}"):
        check_gif_rate(fps)


def test_an_mp4_without_ffmpeg_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stills.shutil, "which", lambda _: None)
    monkeypatch.setattr(stills.importlib.util, "find_spec", lambda _: None)
    with pytest.raises(ValueError, match="pip install imageio-ffmpeg"):
        find_ffmpeg()


def test_an_mp4_has_the_frames_and_the_rate(tmp_path: Path) -> None:
    try:
        program = find_ffmpeg()
    except ValueError as reason:
        pytest.skip(str(reason))
    write_film(tmp_path / "clip.mp4", CLIP, 25)
    command = [program, "-i", str(tmp_path / "clip.mp4"), "-f", "null", "-"]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stderr
    assert "h264" in said
    assert "640x512" in said
    assert "25 fps" in said
    assert "frame=    5" in said
