"""Contacts, feet and accelerations of retargeted BVH files, read back, beside those of the points.

Usage: python -m benchmarks.written_bvh [--json]

One of two people becomes a child, either in turn, in windows of two salsa and three CMU captures.
``points`` is what the solver returns, ``file`` what our reader reads from the files written.

``contacts``: fraction of the joint pairs closer than 10 cm in the source that are closer than 10 cm
after, mean over captures that have any. ``near_mm``: mean change of the distance of pairs closer
than 25 cm in the source. ``foot_mm``: largest difference of height between file and points of an
ankle or toe in stance. ``acceleration_ratio``: largest mean acceleration of a frame, file over
points. ``joints_mm``: mean distance of file and points. ``time_ratio``: writing and reading back
over solving, processor time.
"""

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from benchmarks._captures import real_data
from benchmarks._figures import arguments, show
from benchmarks._retargeting_tasks import N_FRAMES, NEAR, SETTINGS
from pacmo_core.augmentation.bodies import measure_body, profile_scales
from pacmo_core.commands.captures import TwoPersonCapture, read_two_people, write_two_people
from pacmo_core.commands.reading import ReadOptions
from pacmo_core.data.interaction import joint_distances
from pacmo_core.formats.bvh_pairs import BvhPairs
from pacmo_core.formats.registry import DEFAULT_SETTINGS
from pacmo_core.interaction_mesh import prepare, retarget
from pacmo_core.interaction_mesh.mesh import ground_supports

CONTACT = 0.1
TAKES = {"duo_mocap": ("salsa/Easy_01", "salsa/Easy_02"), "cmu_18_19": ("18_07", "18_11", "18_13")}
PROFILE = "child"
FEET = ("ankle", "foot", "toe")

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Result:
    """Figures of one capture with one person changed; distances in metres, times in seconds."""

    n_contacts: int
    contacts: tuple[float, float]  # of the points, of the file
    near: tuple[float, float]
    foot: float
    acceleration_ratio: float
    joints: float
    seconds_of_solving: float
    seconds_of_writing: float


def main() -> None:
    """Measure and print."""
    options = arguments(__doc__ or "").parse_args()
    results = {}
    with TemporaryDirectory() as folder:
        for take, preset, files in _windows(Path(folder)):
            duo = read_two_people(files, ReadOptions(preset=preset), "")
            for changed in (0, 1):
                name = f"{take} {'ab'[changed]}={PROFILE}"
                results[name] = measure(duo, changed, Path(folder) / "out")
                print(_line(name, results[name]), flush=True)
    show(summarise(list(results.values())), as_json=options.json)


def measure(duo: TwoPersonCapture, changed: int, out: Path) -> Result:
    """Retarget, write, read back and compare."""
    scales = [np.ones(len(person.skeleton.bones)) for person in duo.people]
    person = duo.people[changed]
    scales[changed] = profile_scales(measure_body(person.motion, person.skeleton), PROFILE)
    scene = duo.scene
    start = time.process_time()
    points = retarget(prepare(scene, SETTINGS), np.concatenate(scales)[None]).points[0]
    solved = time.process_time()
    a, b = np.split(points.astype(np.float32), [scene.n_joints[0]], axis=1)
    written = write_two_people(duo.moved((a, b)), (scales[0], scales[1]), "", out)
    done = time.process_time()
    found = np.concatenate([w.motion for w in written.people], axis=1, dtype=np.float64)
    n_a = scene.n_joints[0]
    before, of_points, of_file = (_distances(p, n_a) for p in (scene.points, points, found))
    contact, near = before < CONTACT, before < NEAR
    names = [joint.lower() for skeleton in scene.skeletons for joint in skeleton.joints]
    is_foot = np.array([any(word in name for word in FEET) for name in names])
    stance = ground_supports(scene, SETTINGS.support) & is_foot
    return Result(
        n_contacts=int(contact.sum()),
        contacts=(_mean(of_points[contact] < CONTACT), _mean(of_file[contact] < CONTACT)),
        near=(
            _mean(np.abs(of_points - before)[near]),
            _mean(np.abs(of_file - before)[near]),
        ),
        foot=float(np.abs(found - points)[..., 1][stance].max(initial=0)),
        acceleration_ratio=_acceleration_peak(found) / _acceleration_peak(points),
        joints=_mean(np.linalg.norm(found - points, axis=-1)),
        seconds_of_solving=solved - start,
        seconds_of_writing=done - solved,
    )


def summarise(results: list[Result]) -> dict[str, float]:
    """Summarise all captures: means, and the worst difference between file and points."""
    touching = [r for r in results if r.n_contacts]
    return {
        "contacts_points": _mean(np.array([r.contacts[0] for r in touching])),
        "contacts_file": _mean(np.array([r.contacts[1] for r in touching])),
        "contacts_lost_max": max(r.contacts[0] - r.contacts[1] for r in touching),
        "near_points_mm": 1e3 * _mean(np.array([r.near[0] for r in results])),
        "near_file_mm": 1e3 * _mean(np.array([r.near[1] for r in results])),
        "near_added_max_mm": 1e3 * max(r.near[1] - r.near[0] for r in results),
        "foot_max_mm": 1e3 * max(r.foot for r in results),
        "acceleration_ratio_max": max(r.acceleration_ratio for r in results),
        "joints_mm": 1e3 * _mean(np.array([r.joints for r in results])),
        "time_ratio_max": max(r.seconds_of_writing / r.seconds_of_solving for r in results),
    }


def _windows(folder: Path) -> Iterator[tuple[str, str, tuple[Path, ...]]]:
    """Cut the window of each capture with the most near pairs; yield take, preset and files."""
    root = real_data()
    for preset, takes in TAKES.items():
        pairs = BvhPairs(**{**DEFAULT_SETTINGS["bvh"], "preset": preset})
        found = {sequence.name: sequence for sequence in pairs.find(root / preset)}
        for take in takes:
            names = [name for name in found if take in name]
            if len(names) != 1:
                raise SystemExit(f"{root / preset}: wanted one capture {take}; got {len(names)}")
            sequence = found[names[0]]
            near = (joint_distances(pairs.read(sequence).interaction) < NEAR).sum(axis=(1, 2))
            length = min(N_FRAMES, len(near))
            first = int(np.convolve(near, np.ones(length), mode="valid").argmax())
            out = folder / names[0].replace("/", "_")
            yield (
                take,
                preset,
                tuple(
                    _cut(file, first, length, out / f"{number}_{file.name}")
                    for number, file in enumerate(sequence.files)
                ),
            )


def _cut(file: Path, first: int, length: int, out: Path) -> Path:
    """Write some frames of a BVH file."""
    lines = [line for line in file.read_text().splitlines() if line.strip()]
    motion = next(row for row, line in enumerate(lines) if line.strip().upper() == "MOTION")
    rows = lines[motion + 3 :][first : first + length]
    out.parent.mkdir(parents=True, exist_ok=True)
    text = [*lines[: motion + 1], f"Frames: {length}", lines[motion + 2], *rows]
    out.write_text("\n".join(text) + "\n")
    return out


def _distances(points: Array, n_a: int) -> Array:
    """``(T, J_a, J_b)`` metres, between joints of the two people."""
    a, b = points[:, :n_a, None], points[:, None, n_a:]
    distances: Array = np.linalg.norm(a - b, axis=-1)
    return distances


def _acceleration_peak(points: Array) -> float:
    return float(np.linalg.norm(np.diff(points, 2, axis=0), axis=-1).mean(axis=1).max())


def _mean(values: NDArray[np.float64] | NDArray[np.bool_]) -> float:
    """Return the mean; 0 of nothing."""
    return float(values.mean()) if values.size else 0.0


def _line(name: str, result: Result) -> str:
    contacts = f"{result.contacts[0]:.4f} -> {result.contacts[1]:.4f} of {result.n_contacts}"
    near = f"{1e3 * result.near[0]:.2f} -> {1e3 * result.near[1]:.2f} mm"
    return (
        f"{name:24} contacts {contacts:26} near {near:20} foot {1e3 * result.foot:5.2f} mm  "
        f"acceleration {result.acceleration_ratio:.3f}  joints {1e3 * result.joints:.2f} mm  "
        f"time {result.seconds_of_writing:.2f} of {result.seconds_of_solving:.2f} s"
    )


if __name__ == "__main__":
    main()
