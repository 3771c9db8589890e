"""A clip as a film of solid figures, MP4 or GIF, by matplotlib's writers."""

import importlib
import importlib.util
import shutil
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.animation import AbstractMovieWriter, FFMpegWriter, PillowWriter
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pacmo_core.data.interaction import Interaction
from pacmo_core.figures.stills import ASPECT, draw_interaction, fit, onlooker

_INCHES, _DPI = 6.4, 100  # 640 pixels across
_LEAST = 1.9  # metres that a picture shows at least
_GIF_TICKS = 100  # a GIF's frames last whole hundredths of a second


def check_gif_rate(fps: float) -> None:
    """Refuse a rate that a GIF cannot have.

    Raises
    ------
    ValueError
        If a frame does not last a whole number of hundredths of a second, two at least.
    """
    ticks = round(_GIF_TICKS / fps)
    if ticks < 2 or not np.isclose(ticks * fps, _GIF_TICKS, rtol=1e-3):
        raise ValueError(
            f"a GIF's frames last whole hundredths of a second, two at least: "
            f"wanted 50, 33.333, 25, 20, 12.5, 10 ... fps; got {fps:g}"
        )


def find_ffmpeg() -> str:
    """Find the program that writes MP4: imageio-ffmpeg's, or the machine's own.

    Raises
    ------
    ValueError
        If there is none.
    """
    if importlib.util.find_spec("imageio_ffmpeg"):
        return str(importlib.import_module("imageio_ffmpeg").get_ffmpeg_exe())
    if found := shutil.which("ffmpeg"):
        return found
    raise ValueError("MP4 needs ffmpeg: pip install imageio-ffmpeg, or put ffmpeg on the path")


def write_film(path: Path, clip: Interaction, fps: float) -> None:
    """Draw every frame of a clip into a film.

    Parameters
    ----------
    path : ends in .gif or .mp4
    fps : frames a second of the film, and of the clip

    Raises
    ------
    ValueError
        If the rate is none of a GIF's, or an MP4 is wanted and there is no ffmpeg.
    """
    if path.suffix == ".gif":
        check_gif_rate(fps)
        _draw(path, clip, PillowWriter(fps=fps))  # type: ignore[arg-type]  # any number will do
        return
    # Players want an even number of pixels and 4:2:0 colour.
    options = ["-pix_fmt", "yuv420p", "-movflags", "+faststart", "-loglevel", "error"]
    with mpl.rc_context({"animation.ffmpeg_path": find_ffmpeg()}):
        writer = FFMpegWriter(fps=fps, codec="h264", extra_args=options)  # type: ignore[arg-type]
        _draw(path, clip, writer)


def _draw(path: Path, clip: Interaction, writer: AbstractMovieWriter) -> None:
    figure = Figure(figsize=(_INCHES, ASPECT * _INCHES), dpi=_DPI, facecolor="white")
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0, 0, 1, 1))
    seen = onlooker(clip)
    box = fit(clip, range(len(clip.times)), seen, _LEAST)
    with writer.saving(figure, str(path), _DPI):
        for frame in range(len(clip.times)):
            axes.clear()
            draw_interaction(axes, clip, frame, seen=seen, box=box)
            axes.text(0.97, 0.95, _said(clip.times, frame), transform=axes.transAxes, ha="right")
            writer.grab_frame()


def _said(times: NDArray[np.float64], frame: int) -> str:
    return f"{times[frame] - times[0]:.2f} s"
