"""What ``augment`` and ``vary`` say of the motions that they wrote: lines, and a page."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from statistics import fmean

import numpy as np
from numpy.typing import NDArray

from pacmo_core.augmentation.filter import VariationLimits, exceeded_limits
from pacmo_core.commands.captures import TwoPersonCapture, is_parquet
from pacmo_core.commands.motion_checks import (
    MAX_ACCELERATION,
    bone_names,
    bone_turns,
    find_peak,
    joint_accelerations,
)
from pacmo_core.commands.places import Places
from pacmo_core.commands.reading import PEOPLE
from pacmo_core.commands.view import scene_of_people
from pacmo_core.data.interaction import min_point_distance
from pacmo_core.data.names import file_stem
from pacmo_core.figures.numbers import format_fixed
from pacmo_core.figures.variations import limit_text, limits_table, measure_label, measurement_lines
from pacmo_core.figures.viewer import MAX_CLIPS, Scene, render_viewer
from pacmo_core.formats.registry import PersonMotion
from pacmo_core.interaction_mesh import Scene as SolvedScene
from pacmo_core.interaction_mesh import Settings
from pacmo_core.interaction_mesh.mesh import ground_supports
from pacmo_core.interaction_mesh.report import (
    measure_motions,
    measure_people,
    without_common_scale,
)
from pacmo_core.store.files import write_text

Scales = NDArray[np.float64]
WITHOUT_SOLVER = {"primal_residual": 0.0}
# What a page plays of a long capture: more would be slow to open.
MAX_FPS, MAX_FRAMES = 60.0, 3600
MAX_JOLT_LINES = 8
MIN_DISPLACEMENT = 5e-4  # metres: the largest that is printed as nothing
MIN_TURN = 0.05  # degrees: the largest that is printed as nothing
LIMITS = "limits of what looks natural (augment.limits of params.yaml)"


@dataclass(frozen=True)
class Measured:
    """Measurements of one or more variations of a capture.

    Parameters
    ----------
    samples : of each variation, by the names of ``interaction_mesh.Report``
    worse : the person, a or b, in whom a measurement is worse; without those that are of both, or
        equal
    has_contacts : whether joints of the two touch in the capture
    contacts : of each variation
    peaks : lines on single frames: the largest turn of a bone, and jolts
    places : of each variation, in which the place of a measurement is looked up
    displaced : lines on how far each person is from the capture
    near : metres, within which joints of the two are near; 0 if none are in the capture
    """

    samples: tuple[Mapping[str, float], ...]
    worse: Mapping[str, str]
    has_contacts: bool
    contacts: tuple["Contacts", ...] = ()
    peaks: tuple[str, ...] = ()
    places: tuple[Places, ...] = ()
    displaced: tuple[str, ...] = ()
    near: float = 0.0

    def lines(self, limits: VariationLimits) -> Iterator[str]:
        """Yield the lines that a command prints."""
        count = len(self.samples)
        means = f", means of {count} samples" if count > 1 else ""
        yield f"against the capture, measured in what was written{means}:"
        absent = set() if self.has_contacts else {"contacts_kept"}
        if absent:
            none = "no contacts to keep: no compared joints are within 10 cm in the capture"
            yield f"  {none}{self._grip()}"
        shown = [{k: v for k, v in sample.items() if k not in absent} for sample in self.samples]
        yield from measurement_lines(shown, asdict(limits), self.worse)
        if new := [one.new for one in self.contacts]:
            kept = fmean(one.kept for one in self.contacts)
            worst = f", most {max(new):,} in sample {new.index(max(new))}" if count > 1 else ""
            yield (
                f"  {'new contacts':<18}{fmean(new):>11,.0f}  beside {kept:,.0f} that are kept "
                f"(pairs of joints and frames){worst}"
            )
        yield from self.displaced
        yield from self.peaks
        exceeded = [exceeded_limits(sample, limits) for sample in self.samples]
        beyond = sum(map(bool, exceeded))
        if not beyond:
            yield f"all within the {LIMITS}"
        elif count > 1:
            names = Counter(name for sample in exceeded for name in sample).most_common()
            texts = [f"{measure_label(name)} ({number})" for name, number in names]
            yield f"{beyond} of {count} samples beyond the {LIMITS}: {', '.join(texts)}"
            for name, _ in names:
                ratios = [sample.get(name, 0.0) for sample in exceeded]
                number = ratios.index(max(ratios))
                yield f"  worst in sample {number}: {self._beyond(name, number, limits)}"
        else:
            yield f"beyond the {LIMITS}:"
            for name in sorted(exceeded[0], key=lambda name: -exceeded[0][name]):
                yield f"  {self._beyond(name, 0, limits)}"

    def _beyond(self, name: str, number: int, limits: VariationLimits) -> str:
        """Say a measurement of a sample beyond its limit, and where it is worst."""
        text = limit_text(name, self.samples[number][name], asdict(limits)[name])
        place = self.places[number].text(name) if self.places else ""
        return f"{text} (worst: {place})" if place else text

    def _grip(self) -> str:
        """Say what judges a grip whose joints are not within the distance of contact."""
        if not self.near:
            return ""
        return (
            "; a grip whose joints are farther apart, as wrists are in files without hands, is "
            f"judged by near distances, those within {100 * self.near:.0f} cm"
        )


@dataclass(frozen=True)
class Contacts:
    """How many pairs of joints of the two people are in contact, over all frames.

    Parameters
    ----------
    kept : in the capture and in the variation
    new : in the variation alone
    """

    kept: int
    new: int


def count_contacts(scene: SolvedScene, bodies: Scales, points: Scales, distance: float) -> Contacts:
    """Count the contacts of a motion (T, N, 3) metres, without the scale that both bodies share.

    Parameters
    ----------
    bodies : (E,) scales of the bones of both people
    distance : metres, below which joints are in contact
    """
    _, motions = without_common_scale(scene, bodies[None], points[..., None])
    n_a, kept, new = scene.n_joints[0], 0, 0
    for joint in range(n_a):  # all pairs at once would take too much memory
        before, after = (
            np.linalg.norm(motion[:, n_a:] - motion[:, joint, None], axis=-1) < distance
            for motion in (scene.points, motions[..., 0])
        )
        kept += int((before & after).sum())
        new += int((after & ~before).sum())
    return Contacts(kept, new)


def measure_written(
    duo: TwoPersonCapture,
    people: Sequence[tuple[PersonMotion, PersonMotion]],
    scales: Sequence[tuple[Scales, Scales]],
    settings: Settings,
    solved: Mapping[str, float] = WITHOUT_SOLVER,
    in_files: Sequence[tuple[PersonMotion, PersonMotion]] = (),
) -> Measured:
    """Measure motions as they were written against the capture.

    Parameters
    ----------
    people : of each variation
    scales : of the bones of its two bodies, (E,) each
    solved : what a solver says of itself, by the names of ``interaction_mesh.Report``
    in_files : ``people`` with all joints of the files; without them the joints are all
    """
    points = [np.concatenate([p.motion for p in pair], axis=1, dtype=np.float64) for pair in people]
    supports = ground_supports(duo.scene, settings.support)
    bodies = np.stack([np.concatenate(pair) for pair in scales])
    motions = np.stack(points, axis=-1)
    found = measure_motions(duo.scene, settings, supports, bodies, motions)
    samples = tuple(
        {**solved, **{name: float(values[number]) for name, values in found.items()}}
        for number in range(len(people))
    )
    unscaled = without_common_scale(duo.scene, bodies, motions)
    a, b = measure_people(duo.scene, supports, *unscaled)
    apart = {name: float((b[name] - a[name]).mean()) for name in a}
    worse = {name: PEOPLE[int(by > 0)] for name, by in apart.items() if by}
    first, second = (person.motion for person in duo.people)
    nearest = float(min_point_distance(first, second).min())
    contacts = tuple(
        count_contacts(duo.scene, body, motion, settings.contact_distance)
        for body, motion in zip(bodies, points, strict=True)
    )
    worse_in = [{name: int(b[name][v] > a[name][v]) for name in a} for v in range(len(people))]
    places = tuple(
        Places(duo.scene, supports, body, motion, settings.contact_distance, in_whom)
        for body, motion, in_whom in zip(
            unscaled[0], np.moveaxis(unscaled[1], -1, 0), worse_in, strict=True
        )
    )
    return Measured(
        samples,
        worse,
        nearest < settings.contact_distance,
        contacts,
        tuple(_peak_lines(duo, people, in_files)),
        places,
        tuple(_displacement_lines(duo, people, scales)),
        settings.near_distance if nearest < settings.near_distance else 0.0,
    )


def _displacement_lines(
    duo: TwoPersonCapture,
    variations: Sequence[tuple[PersonMotion, PersonMotion]],
    scales: Sequence[tuple[Scales, Scales]],
) -> Iterator[str]:
    """Yield for each person by how far joints and pelvis are from where they were captured."""
    for row, label in enumerate(PEOPLE):
        own = duo.people[row]
        moved = np.stack(
            [np.linalg.norm(pair[row].motion - own.motion, axis=-1) for pair in variations]
        )
        same = ", whose body is the same," * all(np.allclose(pair[row], 1) for pair in scales)
        root = own.skeleton.root
        parts = [
            f"{what}by up to {100 * values.max():.1f} cm{_displaced_at(values, names, own)}"
            for what, values, names in (
                ("", moved, own.skeleton.joints),
                ("the pelvis ", moved[:, :, [root]], (own.skeleton.joints[root],)),
            )
        ]
        yield f"  person {label}{same} moves away from the capture {', '.join(parts)}"


def _displaced_at(values: Scales, names: Sequence[str], own: PersonMotion) -> str:
    """Say where the largest of displacements (V, T, J) is; nothing if there is none."""
    if not values.max() > MIN_DISPLACEMENT:
        return ""
    number, frame, joint = (int(i) for i in np.unravel_index(values.argmax(), values.shape))
    of_sample = f" of sample {number}" if len(values) > 1 else ""
    time = own.times[frame] - own.times[0]
    return f" ({names[joint]} in frame {frame}, {time:.2f} s{of_sample})"


def _peak_lines(
    duo: TwoPersonCapture,
    variations: Sequence[tuple[PersonMotion, PersonMotion]],
    in_files: Sequence[tuple[PersonMotion, PersonMotion]],
) -> Iterator[str]:
    """Yield the turn that is most above the capture's, and accelerations that it does not have."""
    turns, jolts = list[tuple[float, str]](), list[str]()
    whole = duo.bodies if duo.bodies and in_files else duo.people
    bodies = in_files if duo.bodies and in_files else variations
    for number, (pair, all_joints) in enumerate(zip(variations, bodies, strict=True)):
        of_sample = f"sample {number}, " if len(variations) > 1 else ""
        for row, label in enumerate(PEOPLE):
            whom = f"{of_sample}person {label}"
            if len(pair[row].times) > 1:
                body = all_joints[row].select_joints(whole[row].skeleton)
                turns.append(_largest_added_turn(whom, whole[row], body))
            jolts += _jolt_line(whom, duo.people[row], pair[row])
    added, line = max(turns, default=(0.0, ""))
    if added > MIN_TURN:
        yield line
    yield from jolts[:MAX_JOLT_LINES]
    if more := jolts[MAX_JOLT_LINES:]:
        yield f"  and {len(more)} more jolts"


def _largest_added_turn(whom: str, own: PersonMotion, person: PersonMotion) -> tuple[float, str]:
    """Return by how many degrees a bone turns more than in the capture, and a line on it."""
    before, after = (bone_turns(p.skeleton, p.motion) for p in (own, person))
    peak = find_peak(after - before, bone_names(person.skeleton), person.times)
    at = peak.row, peak.column
    line = (
        f"  largest added turn of a bone from one frame to the next: {format_fixed(after[at], 1)}° "
        f"{peak.place}, {format_fixed(before[at], 1)}° in the capture ({whom}, bone to "
        f"{peak.joint})"
    )
    return float(after[at] - before[at]), line


def _jolt_line(whom: str, own: PersonMotion, person: PersonMotion) -> Iterator[str]:
    before, after = (joint_accelerations(p.times, p.motion) for p in (own, person))
    most = before.max(initial=0.0)
    if after.max(initial=0.0) > max(MAX_ACCELERATION, most):
        peak = find_peak(after, person.skeleton.joints, person.times)
        yield (
            f"  {whom} has a jolt: {peak.joint} accelerates by {after.max():.0f} m/s² "
            f"{peak.place}, wanted at most {MAX_ACCELERATION:.0f} (in the capture at most "
            f"{most:.0f})"
        )


def write_variation_page(
    duo: TwoPersonCapture,
    variations: Sequence[tuple[PersonMotion, PersonMotion]],
    measured: Measured,
    limits: VariationLimits,
    out: Path,
) -> Path:
    """Write the page beside the written files.

    Parameters
    ----------
    duo : the capture
    variations : the two people of each, as they are in the files; the page has the first ones
    measured : their measurements
    limits : of what looks natural
    out : of the command: a file or a folder

    Returns
    -------
    its path: FILE.html beside FILE.bvh and FILE.parquet, NAME.html in a folder
    """
    in_folder = not is_parquet(out) and out.suffix.lower() != ".bvh"
    page = out / f"{file_stem(duo.name)}.html" if in_folder else out.with_suffix(".html")
    labels = [f"variation {number}" for number in range(min(len(variations), MAX_CLIPS - 1))]
    labels = labels if len(variations) > 1 else ["variation"]
    shown_people = zip(labels, variations, strict=False)
    scenes = [_scene("source", duo.people), *(_scene(*shown) for shown in shown_people)]
    columns = [
        (label, figures, set(exceeded_limits(figures, limits)))
        for label, figures in zip(labels, measured.samples, strict=False)
    ]
    table = limits_table(columns, asdict(limits))
    shown = _shown_frames(duo.people[0])
    n_frames = len(duo.people[0].times)
    played = "" if n_frames == len(shown) else f", {len(shown):,} of {n_frames:,} frames"
    what = "variation" if len(labels) == 1 else f"{len(labels)} of {len(variations)} variations"
    title = f"{duo.name}: source and {what}{played}"
    write_text(page, render_viewer(scenes, contact=0.1, title=title, table=table))
    return page


def _scene(label: str, people: tuple[PersonMotion, PersonMotion]) -> Scene:
    frames = _shown_frames(people[0])
    times = people[0].times[frames] - people[0].times[0]
    shown = [replace(person, times=times, motion=person.motion[frames]) for person in people]
    return scene_of_people(label, shown)


def _shown_frames(person: PersonMotion) -> list[int]:
    """List the frames that the page plays: at most ``MAX_FPS``, from the start ``MAX_FRAMES``."""
    fps = float(1 / np.median(np.diff(person.times)))
    step = max(1, round(fps / MAX_FPS))
    return list(range(0, len(person.times), step))[:MAX_FRAMES]
