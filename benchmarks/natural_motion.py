"""Whether variations look natural: what changes in them that the other body does not explain.

Usage: python -m benchmarks.natural_motion [--json] [--captures PRESET=FOLDER ...] [--pictures DIR]

Twelve windows of real captures, of four classes, on ten pairs of bodies each: in eight one person
changes, in two both do, differently. Every measurement is of the person for whom it is worse, on
the positions that are written (``interaction_mesh.Report``). Keys are CLASS_MEASURE, the mean over
variations in which one person changes; CLASS_MEASURE_both, over those in which both do; and
CLASS_MEASURE_worst, over all. A class follows from the capture: on the floor, a joint but the legs'
is within 20 cm of the lowest in half of the frames; embrace, the trunks are within 30 cm in half of
the frames, with 20 near pairs of joints; far, fewer than one near pair a frame; close, all others.

``--captures`` measures all captures of a folder of BVH pairs instead.
"""

import os
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from benchmarks._captures import real_data
from benchmarks._figures import arguments, show
from benchmarks._retargeting_tasks import SETTINGS
from pacmo_core.augmentation.bodies import measure_body, profile_scales
from pacmo_core.augmentation.run import scene_from
from pacmo_core.data.interaction import Interaction, joint_distances
from pacmo_core.formats.bvh_pairs import BvhPairs
from pacmo_core.interaction_mesh import Scene, prepare, retarget
from pacmo_core.interaction_mesh.body_parts import scene_bone_kinds, trunk_joints
from pacmo_core.interaction_mesh.scene import Array

N_FRAMES = 360
NEAR_DISTANCE = 0.25
CLASSES = ("far", "close", "embrace", "floor")
# Captures, and the first frame of the window; None for the frames with the most near pairs.
WINDOWS: tuple[tuple[str, str, str, int | None], ...] = (
    ("cmu_18_19", "cmu_18_19", "18_19/18_01", None),
    ("cmu_18_19", "cmu_18_19", "18_19/18_08", None),
    ("cmu_18_19", "cmu_18_19", "18_19/18_10", None),
    ("cmu_18_19", "cmu_18_19", "18_19/18_15", None),
    ("duo_mocap", "duo_mocap", "salsa/Easy_01_30fps", None),
    ("duo_mocap", "duo_mocap", "salsa/Easy_02_30fps", None),
    ("duo_mocap", "duo_mocap", "acts/greeting002_30fps", None),
    ("duo_mocap", "duo_mocap", "acts/one_leg_back_stretch_30fps", None),
    ("duo_mocap", "duo_mocap_embraces", "move_02_02_30fps", None),
    ("duo_mocap", "duo_mocap_embraces", "back_lift001_30fps", None),
    ("duo_mocap", "duo_mocap", "acts/push_up001_30fps", 60),
    ("duo_mocap", "duo_mocap", "acts/push_up001_30fps", 440),
)
# Factor in the key of each measurement: degrees, fractions, centimetres or millimetres.
MEASURES = {
    "knee_mean": ("knee_change", 1),
    "knee_p95": ("knee_change_p95", 1),
    "elbow_p95": ("elbow_change_p95", 1),
    "hip_p95": ("hip_change_p95", 1),
    "shoulder_p95": ("shoulder_change_p95", 1),
    "spine_p95": ("spine_change_p95", 1),
    "pelvis_cm": ("pelvis_height_error", 100),
    "support_height_cm": ("support_height_error", 100),
    "spine_bend": ("spine_bend", 1),
    "trunk_change": ("trunk_change", 1),
    "below_floor_cm": ("below_floor", 100),
    "near_mm": ("near_distance_error", 1000),
    "kept_strict": ("contacts_kept", 1),
    "kept_with_slack": ("contacts_kept_with_slack", 1),
    "peak_acceleration_ratio": ("peak_acceleration_ratio", 1),
    "seam_ratio": ("seam_ratio", 1),
    "knee_flips": ("knee_flips", 1),
    "elbow_flips": ("elbow_flips", 1),
    "capsule_penetration_cm": ("capsule_penetration", 100),
    "added_foot_skate_cm_s": ("added_foot_skate", 100),
    "iterations": ("iterations", 1),
}
HIGHER_IS_BETTER = ("kept_strict", "kept_with_slack")


@dataclass(frozen=True)
class Window:
    """A stretch of a capture, and its class."""

    name: str
    kind: str
    interaction: Interaction


@dataclass(frozen=True)
class Result:
    """Measurements of one variation."""

    window: str
    kind: str
    body: str
    is_both: bool
    values: dict[str, float]


def main() -> None:
    """Measure and print."""
    parser = arguments(__doc__ or "")
    parser.add_argument("--captures", nargs="*", default=[], metavar="PRESET=FOLDER")
    options = parser.parse_args()
    root = real_data()
    windows = list(_folders(options.captures) if options.captures else _listed(root))
    if not windows:
        raise SystemExit(f"no captures in {root}: set PACMO_REAL_DATA to a folder of captures")
    os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    with ProcessPoolExecutor(os.cpu_count(), mp_context=get_context("spawn")) as pool:
        results = [result for part in pool.map(measure, windows) for result in part]
    if not options.json:
        for result in results:
            print(_line(result), flush=True)
    show(summarise(results), as_json=options.json)


def _listed(root: Path) -> Iterator[Window]:
    for preset, folder, name, start in WINDOWS:
        raw_format = bvh_pairs(preset)
        found = [s for s in raw_format.find(root / folder) if s.name == name]
        for sequence in found:
            yield window(name, raw_format.read(sequence).interaction, start)


def _folders(words: list[str]) -> Iterator[Window]:
    for word in words:
        preset, _, folder = word.partition("=")
        raw_format = bvh_pairs(preset)
        for sequence in raw_format.find(Path(folder)):
            if len(sequence.files) > 1:
                yield window(sequence.name, raw_format.read(sequence).interaction, None)


def bvh_pairs(preset: str) -> BvhPairs:
    """Return the reader of a preset."""
    return BvhPairs(
        preset=preset,
        unit=None,
        up=None,
        fps=None,
        end_sites=False,
        skip_frames=0,
        max_root_distance=2.0 if preset == "duo_mocap" else None,
    )


def window(name: str, whole: Interaction, start: int | None) -> Window:
    """Cut a window, from the frames with the most near pairs if no start is given."""
    if start is None:
        near = (joint_distances(whole) < NEAR_DISTANCE).sum(axis=(1, 2))
        size = min(N_FRAMES, len(near))
        start = int(np.convolve(near, np.ones(size), mode="valid").argmax())
    cut = whole.frames(start, min(start + N_FRAMES, len(whole.times)))
    return Window(name if not start else f"{name}[{start}]", kind_of(cut), cut)


def kind_of(interaction: Interaction) -> str:
    """Return the class of a window."""
    scene = scene_from(interaction)
    near = float((joint_distances(interaction) < NEAR_DISTANCE).sum(axis=(1, 2)).mean())
    a, b = (scene.points[:, joints] for joints in trunk_joints(scene))
    trunks = np.linalg.norm(a[:, :, None] - b[:, None], axis=-1).min(axis=(1, 2))
    if max(_low_fraction(scene, person) for person in (0, 1)) >= 0.5:
        return "floor"
    if (trunks < 0.3).mean() >= 0.5 and near >= 20:
        return "embrace"
    return "far" if near < 1 else "close"


def _low_fraction(scene: Scene, person: int) -> float:
    """Return the fraction of frames in which a joint but the legs' is near the lowest height."""
    n_a, heights = scene.n_joints[0], scene.points[..., 1]
    own = slice(None, n_a) if person == 0 else slice(n_a, None)
    named = zip(scene.bones[:, 1].tolist(), scene_bone_kinds(scene), strict=True)
    joints = [j for j, kind in named if kind not in ("shin", "foot") and (j >= n_a) == bool(person)]
    return float((heights[:, joints].min(axis=1) < heights[:, own].min() + 0.2).mean())


def bodies(interaction: Interaction) -> tuple[list[str], Array]:
    """Return ten pairs of bodies: their names, and bone scales (10, E)."""
    people = (interaction.person_a, interaction.person_b)
    measured = [measure_body(motion, interaction.skeleton) for motion in people]
    same = np.ones(len(measured[0].segments))
    names, rows = [], []
    for person, body in zip("ab", measured, strict=True):
        choices = {p: profile_scales(body, p) for p in ("child", "tall_adult")}
        choices |= {f"{scale}": same * scale for scale in (0.75, 1.25)}
        for name, scales in choices.items():
            names.append(f"{person} {name}")
            rows.append(np.concatenate([scales, same] if person == "a" else [same, scales]))
    for first, second in ((0.75, 1.25), (1.25, 0.75)):
        names.append(f"a {first} b {second}")
        rows.append(np.concatenate([same * first, same * second]))
    return names, np.array(rows)


def measure(one: Window) -> list[Result]:
    """Retarget a window to all bodies and measure."""
    names, scales = bodies(one.interaction)
    result = retarget(prepare(scene_from(one.interaction), SETTINGS), scales)
    return [
        Result(one.name, one.kind, name, " b " in name, _values(report))
        for name, report in zip(names, result.reports, strict=True)
    ]


def _values(report: object) -> dict[str, float]:
    return {key: factor * getattr(report, name) for key, (name, factor) in MEASURES.items()}


def summarise(results: list[Result]) -> dict[str, float]:
    """Return means and worst values by class."""
    figures: dict[str, float] = {"variations": len(results)}
    for kind in CLASSES:
        of_kind = [result for result in results if result.kind == kind]
        for key in MEASURES if of_kind else ():
            for is_both, suffix in ((False, ""), (True, "_both")):
                values = [r.values[key] for r in of_kind if r.is_both == is_both]
                figures[f"{kind}_{key}{suffix}"] = float(np.mean(values))
            worst = min if key in HIGHER_IS_BETTER else max
            figures[f"{kind}_{key}_worst"] = worst(r.values[key] for r in of_kind)
    deep = [r.values["capsule_penetration_cm"] > 2 for r in results]
    figures["deeper_than_2_cm"] = float(np.mean(deep))
    return figures


def _line(result: Result) -> str:
    words = "  ".join(f"{key} {value:.3g}" for key, value in result.values.items())
    return f"{result.kind:8} {result.window:34} {result.body:16} {words}"


if __name__ == "__main__":
    main()
