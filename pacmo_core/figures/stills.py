"""Still images and films (MP4, GIF) of one or two people, drawn by matplotlib."""

import importlib
import importlib.util
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.animation import AbstractMovieWriter, FFMpegWriter, PillowWriter
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d

from pacmo_core.data.skeleton import Skeleton, bare_names
from pacmo_core.figures.body_shape import OBJECT_RADIUS, make_body_shape, objects
from pacmo_core.figures.viewer import Scene
from pacmo_core.formats.resample import frame_rate

Array = NDArray[np.float64]

COLOURS = ("#0072b2", "#d55e00")  # the viewer's: person a blue, person b vermilion
FLOOR, SHADOW, METRES = "#f4f1ec", "#d9d3c8", "#e7e2d9"
FOLLOW_SECONDS = 1.0  # over which the picture of a film moves
ELEVATION = 0.24  # radians by which the camera looks down

# Diameter in metres, by a word in the name of the bone's child; the first match applies.
WIDTHS = (
    (("tip", "thumb"), 0.035),
    (("hand",), 0.06),
    (("wrist", "foot", "toe"), 0.065),
    (("elbow", "ankle", "heel"), 0.085),
    (("knee",), 0.12),
    (("shoulder", "hip", "collar"), 0.12),
    (("spine", "back", "torso"), 0.20),
    (("neck", "head"), 0.08),
)
ASPECT = 0.8  # height of a picture over its width
MARGIN = np.array([0.22, 0.24])  # metres around the joints, for limbs, heads and the label
TIME_POINTS, TITLE_POINTS = 3.2, 4.2  # size of texts in a strip, for each inch of a picture's width


class Box(NamedTuple):
    """The visible rectangle, in metres to the right of and above the centre of the camera."""

    left: float
    bottom: float
    width: float


@dataclass(frozen=True)
class Camera:
    """The camera of a film strip.

    Parameters
    ----------
    centre : (3,) metres, the point on the floor in the middle of the picture
    right : (3,) horizontal unit vector to the right of the picture
    """

    centre: Array
    right: Array


def choose_camera(scene: Scene) -> Camera:
    """Return a camera that sees two people side by side, with the floor at the lowest foot."""
    # Rotated a little, so that arms that reach along the line between the two stay visible.
    angle = scene.yaw + 0.45
    everyone = scene.positions
    centre = everyone.mean(axis=(0, 1))
    centre[1] = np.percentile(everyone[..., 1].min(axis=1), 20)
    return Camera(centre, np.array([np.cos(angle), 0.0, -np.sin(angle)]))


def project(points: Array, camera: Camera) -> Array:
    """Project points (..., 3) to (..., 3): right, up and nearness in metres."""
    away = np.cross(np.array([0.0, 1.0, 0.0]), camera.right)
    x, y, near = (
        (points - camera.centre) @ axis for axis in (camera.right, np.array([0.0, 1.0, 0.0]), -away)
    )
    c, s = np.cos(ELEVATION), np.sin(ELEVATION)
    return np.stack([x, c * y - s * near, s * y + c * near], axis=-1)


def bone_widths(skeleton: Skeleton) -> list[float]:
    """Return the diameter of each of ``skeleton.body_bones``, in metres."""
    bare = bare_names(skeleton.joints)
    names = [bare[child].lower() for _, child in skeleton.body_bones]
    return [
        next((w for words, w in WIDTHS if any(word in name for word in words)), 0.09)
        for name in names
    ]


def fit_view(scene: Scene, frames: Sequence[int], camera: Camera, min_width: float) -> Box:
    """Return the smallest rectangle that shows all people completely in every frame.

    Parameters
    ----------
    min_width : metres
    """
    low, high = _extent(scene, camera)
    frames = list(frames)
    return _box(low[frames].min(axis=0), high[frames].max(axis=0), min_width)


def follow_people(scene: Scene, camera: Camera, min_width: float) -> list[Box]:
    """Return a rectangle for each frame, which follows all people and shows them completely.

    Its ends are means over ``FOLLOW_SECONDS`` of the outermost ends in as many seconds: smooth, and
    outside of all people in every frame.

    Parameters
    ----------
    min_width : metres
    """
    size = 2 * round(FOLLOW_SECONDS / 2 * frame_rate(scene.times)) + 1
    outermost = (minimum_filter1d, maximum_filter1d)
    ends = [
        uniform_filter1d(outer(end, size, axis=0, mode="nearest"), size, axis=0, mode="nearest")
        for end, outer in zip(_extent(scene, camera), outermost, strict=True)
    ]
    return [_box(low, high, min_width) for low, high in zip(*ends, strict=True)]


def _extent(scene: Scene, camera: Camera) -> tuple[Array, Array]:
    """``(T, 2)`` each, metres: the lowest and highest ends of all people in the picture."""
    flat = project(scene.positions, camera)[..., :2]
    return flat.min(axis=1), flat.max(axis=1)


def _box(low: Array, high: Array, min_width: float) -> Box:
    low, high = low - MARGIN, high + MARGIN
    width = max(min_width, high[0] - low[0], (high[1] - low[1]) / ASPECT)
    left, bottom = 0.5 * (low + high) - 0.5 * width * np.array([1.0, ASPECT])
    return Box(float(left), float(bottom), float(width))


def draw_people(axes: Axes, scene: Scene, frame: int, *, camera: Camera, box: Box) -> None:
    """Draw all people at a frame; use one camera for a whole strip."""
    axes.set(
        xlim=(box.left, box.left + box.width),
        ylim=(box.bottom, box.bottom + ASPECT * box.width),
        aspect="equal",
    )
    axes.set_facecolor(FLOOR)
    axes.tick_params(bottom=False, left=False, labelbottom=False, labelleft=False)
    for spine in axes.spines.values():
        spine.set_visible(False)
    points = axes.bbox.width / axes.figure.dpi * 72.0 / box.width
    for motion, body, colour in zip(scene.people, scene.skeletons, COLOURS, strict=False):
        widths = np.array(bone_widths(body)) * points
        pose = motion[frame].astype(np.float64)
        flat = project(np.where([False, True, False], camera.centre[1], pose), camera)[:, :2]
        shadow = [flat[bone] for bone in body.body_bones]
        axes.add_collection(
            LineCollection(shadow, linewidths=widths, colors=SHADOW, capstyle="round", zorder=0)
        )
        _draw_body(axes, body, project(pose, camera), widths, colour)


def _draw_body(axes: Axes, skeleton: Skeleton, pose: Array, widths: Array, colour: str) -> None:
    """Draw bones as round lines with white edges; nearer bones are lighter and in front."""
    tone = np.array(to_rgb(colour))
    for (parent, child), width in zip(skeleton.body_bones, widths, strict=True):
        ends = pose[[parent, child]]
        near = ends[:, 2].mean()
        light = np.clip(0.88 + 0.45 * (near - pose[:, 2].mean()), 0.62, 1.12)
        for extra, tint in ((1.1, (1.0, 1.0, 1.0)), (0.0, np.clip(tone * light, 0.0, 1.0))):
            axes.plot(
                *ends[:, :2].T,
                color=tint,
                linewidth=width + extra,
                solid_capstyle="round",
                zorder=10.0 + near - 0.01 * (extra > 0),
            )
    shape = make_body_shape(skeleton)
    balls = [([joint], OBJECT_RADIUS) for joint in objects(skeleton)]
    if shape.head:
        balls.append((list(shape.head), shape.head_radius))
    for joints, radius in balls:
        x, y, near = pose[joints].mean(axis=0)
        disc = Circle((x, y), radius, facecolor=tone, edgecolor="white", linewidth=0.6)
        disc.set_zorder(10.0 + near + 0.02)
        axes.add_patch(disc)


def film_strip(
    scenes: Sequence[tuple[Scene, Sequence[int]]],
    *,
    min_width: float,
    inches: float,
    follow: bool = False,
) -> Figure:
    """Return a figure with one row of frames for each scene, whose label is the row's title.

    Parameters
    ----------
    scenes : with their frames; the same number of frames of each
    min_width : metres that a picture shows at least
    inches : width of a picture
    follow : whether each picture is about the people in it, over the lines of whole metres and in
        one scale, and not about those of the whole row
    """
    rows, columns = len(scenes), len(scenes[0][1])
    figure = Figure(figsize=(columns * inches, rows * ASPECT * inches), facecolor="white")
    cameras = [choose_camera(scene) for scene, _ in scenes]
    of_rows = list(zip(scenes, cameras, strict=True))
    if follow:
        seen = [
            fit_view(s, [frame], c, min_width) for (s, frames), c in of_rows for frame in frames
        ]
        min_width = max(box.width for box in seen)
    for row, ((scene, frames), camera) in enumerate(of_rows):
        together = [frames] * columns if not follow else [[frame] for frame in frames]
        boxes = [fit_view(scene, shown, camera, min_width) for shown in together]
        for column, (frame, box) in enumerate(zip(frames, boxes, strict=True)):
            corner = (column / columns + 0.004, 1.0 - (row + 1) / rows + 0.004)
            axes = figure.add_axes((*corner, 1.0 / columns - 0.008, 1.0 / rows - 0.008))
            if follow:
                _draw_metres(axes, camera, box)
            draw_people(axes, scene, frame, camera=camera, box=box)
            time = f"{scene.times[frame]:.2f} s"
            where, small, large = axes.transAxes, TIME_POINTS * inches, TITLE_POINTS * inches
            axes.text(0.97, 0.94, time, transform=where, ha="right", fontsize=small, color="#777")
            if column == 0:
                axes.text(0.03, 0.93, scene.label, transform=where, fontsize=large, color="#222")
    return figure


_INCHES, _DPI = 6.4, 100  # 640 pixels wide
_STRIP_ROWS, _STRIP_COLUMNS = 4, 4
_STRIP_INCHES = 4.8  # of a picture in a strip
_MIN_VIEW = 1.9  # metres
_GIF_TICKS = 100  # per second; a frame lasts a whole number of them


def check_gif_rate(fps: float) -> None:
    """Reject a frame rate that a GIF cannot have.

    Raises
    ------
    ValueError
        If a frame does not last a whole number of hundredths of a second, at least two.
    """
    ticks = round(_GIF_TICKS / fps)
    if ticks < 2 or not np.isclose(ticks * fps, _GIF_TICKS, rtol=1e-3):
        raise ValueError(
            f"frames of a GIF last whole hundredths of a second, at least two: "
            f"wanted 50, 33.333, 25, 20, 12.5, 10 ... fps; got {fps:g}"
        )


def find_ffmpeg() -> str:
    """Return the path of ffmpeg: that of imageio-ffmpeg, or of the system.

    Raises
    ------
    ValueError
        If there is none.
    """
    if importlib.util.find_spec("imageio_ffmpeg"):
        return str(importlib.import_module("imageio_ffmpeg").get_ffmpeg_exe())
    if program := shutil.which("ffmpeg"):
        return program
    raise ValueError("MP4 needs ffmpeg: pip install imageio-ffmpeg, or put ffmpeg on the path")


def write_film(path: Path, scene: Scene, fps: float) -> None:
    """Write a film of every frame of a clip.

    Parameters
    ----------
    path : ends in .gif or .mp4
    fps : of the film and of the clip

    Raises
    ------
    ValueError
        If a GIF cannot have this rate, or ffmpeg is not installed for an MP4.
    """
    if path.suffix == ".gif":
        check_gif_rate(fps)
        _draw_frames(path, scene, PillowWriter(fps=fps))  # type: ignore[arg-type]  # accepts any number
        return
    # Players require an even number of pixels and 4:2:0 colour.
    options = ["-pix_fmt", "yuv420p", "-movflags", "+faststart", "-loglevel", "error"]
    with mpl.rc_context({"animation.ffmpeg_path": find_ffmpeg()}):
        writer = FFMpegWriter(fps=fps, codec="h264", extra_args=options)  # type: ignore[arg-type]
        _draw_frames(path, scene, writer)


def write_strip(path: Path, scene: Scene) -> None:
    """Write a picture of evenly spaced instants of a scene, the first and the last among them.

    Parameters
    ----------
    path : its suffix is the format, such as .png
    scene : of one frame or more
    """
    last = len(scene.times) - 1
    frames = np.linspace(0, last, _STRIP_ROWS * _STRIP_COLUMNS).round().astype(int)
    bare = replace(scene, label="")
    rows = [(bare, row.tolist()) for row in frames.reshape(_STRIP_ROWS, _STRIP_COLUMNS)]
    figure = film_strip(rows, min_width=_MIN_VIEW, inches=_STRIP_INCHES, follow=True)
    figure.savefig(path, dpi=_DPI)


def _draw_frames(path: Path, scene: Scene, writer: AbstractMovieWriter) -> None:
    figure = Figure(figsize=(_INCHES, ASPECT * _INCHES), dpi=_DPI, facecolor="white")
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0, 0, 1, 1))
    camera = choose_camera(scene)
    boxes = follow_people(scene, camera, _MIN_VIEW)
    with writer.saving(figure, str(path), _DPI):
        for frame, box in enumerate(boxes):
            axes.clear()
            _draw_metres(axes, camera, box)
            draw_people(axes, scene, frame, camera=camera, box=box)
            axes.text(
                0.97, 0.95, _time_label(scene.times, frame), transform=axes.transAxes, ha="right"
            )
            writer.grab_frame()


def _draw_metres(axes: Axes, camera: Camera, box: Box) -> None:
    """Draw the lines of whole metres on the floor, as the picture moves over it."""
    towards = np.cross(camera.right, np.array([0.0, 1.0, 0.0]))
    corners = np.array(
        [
            camera.centre + right * camera.right - up / np.sin(ELEVATION) * towards
            for right in (box.left, box.left + box.width)
            for up in (box.bottom, box.bottom + ASPECT * box.width)
        ]
    )
    low, high = np.floor(corners.min(axis=0)), np.ceil(corners.max(axis=0))
    lines = []
    for axis in (0, 2):
        for metre in np.arange(low[axis], high[axis] + 1):
            line = np.stack([low, high])
            line[:, axis], line[:, 1] = metre, camera.centre[1]
            lines.append(project(line, camera)[:, :2])
    axes.add_collection(LineCollection(lines, linewidths=0.8, colors=METRES, zorder=-1))


def _time_label(times: NDArray[np.float64], frame: int) -> str:
    return f"{times[frame] - times[0]:.2f} s"
