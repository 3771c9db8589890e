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
from pacmo_core.commands.places import (
    FRAME_MEASURES,
    MIN_LOSS,
    FrameCheck,
    People,
    Places,
    captured_turn_lines,
    check_people,
    worst_of,
)
from pacmo_core.commands.reading import PEOPLE
from pacmo_core.commands.sample_table import samples_of
from pacmo_core.commands.view import scene_of_people
from pacmo_core.data.interaction import min_point_distance
from pacmo_core.data.names import file_stem
from pacmo_core.figures.variations import (
    MEASURES,
    PRINTED,
    limit_text,
    limits_table,
    measure_label,
    measurement_lines,
)
from pacmo_core.figures.viewer import MAX_CLIPS, Scene, render_viewer
from pacmo_core.formats.registry import PersonMotion
from pacmo_core.formats.resample import frame_rate
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
MIN_DISPLACEMENT = 5e-4  # metres: the largest that is printed as nothing
LIMITS = "limits of what looks natural (augment.limits of params.yaml, and those above)"


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
    checks : of each variation, by the names of ``FRAME_MEASURES``, and ``below_floor``
    captured : lines on frames in which the capture itself turns a bone by more than people do
    places : of each variation, in which the place of a measurement is looked up
    displaced : lines on how far each person is from the capture
    near : metres, within which joints of the two are near; 0 if none are in the capture
    """

    samples: tuple[Mapping[str, float], ...]
    worse: Mapping[str, str]
    has_contacts: bool
    contacts: tuple["Contacts", ...] = ()
    checks: tuple[Mapping[str, FrameCheck], ...] = ()
    captured: tuple[str, ...] = ()
    places: tuple[Places, ...] = ()
    displaced: tuple[str, ...] = ()
    near: float = 0.0

    def lines(self, limits: VariationLimits, advice: str = "") -> Iterator[str]:
        """Yield the lines that a command prints.

        Parameters
        ----------
        advice : what to do where near distances change more than by scaling, or contacts are lost
        """
        count = len(self.samples)
        rows = list(self._rows(limits))
        alike = count > 1 and {notes for _, notes in rows} == {ALIKE}
        of_samples = f"; the {count} samples are alike" if alike else f"; means of {count} samples"
        yield (
            "changes against the capture, measured in what was written (docs/augment.md)"
            f"{of_samples if count > 1 else ''}:"
        )
        if not self.has_contacts:
            none = "no contacts to keep: no compared joints are within 10 cm in the capture"
            yield f"  {none}{self._grip()}"
        for row, note in rows:
            yield f"{row}, {note}" if note and not alike else row
        yield from self.displaced
        yield from self.captured
        near = list(self._near_lines())
        yield from self._verdict(limits, is_near_worse=bool(near))
        yield from near
        lost = any("contacts_kept" in self._exceeded(n, limits) for n in range(count))
        if (near or lost) and advice:
            yield f"  {advice}"

    def _rows(self, limits: VariationLimits) -> Iterator[tuple[str, str]]:
        """Yield a row for each measurement, and which of several samples is the worst by it."""
        absent = set() if self.has_contacts else {"contacts_kept"}
        names = [name for name in PRINTED if name in self.samples[0] and name not in absent]
        means = {
            name: fmean(sample[name] for sample in self.samples)
            for name in (*names, "near_distance_error_naive")
        }
        rows = measurement_lines(means, asdict(limits), self.worse)
        for name, row in zip(names, rows, strict=True):
            measure, values = MEASURES[name], [sample[name] for sample in self.samples]
            number = max(range(len(values)), key=lambda n: measure.fault(values[n]))
            notes = {"near_distance_error": ", no limit"}.get(name, "")
            if name == "below_floor" and self.checks:
                notes = f", {self.checks[number][name].captured}"
            yield row + notes, _worst(list(map(measure.text, values)), number)
        for name, frame_measure in FRAME_MEASURES.items():
            checks = [of_one[name] for of_one in self.checks if name in of_one]
            if checks:
                number = max(range(len(checks)), key=lambda n: checks[n].value / checks[n].limit)
                texts = [frame_measure.text(check.value) for check in checks]
                mean = frame_measure.text(fmean(check.value for check in checks))
                wanted = frame_measure.limit_text(checks[number])
                row = _row(frame_measure.label, mean, f"{wanted} ({checks[number].place})")
                yield row, _worst(texts, number)
        if any(one.kept or one.new for one in self.contacts):
            new, kept = ([getattr(one, n) for one in self.contacts] for n in ("new", "kept"))
            note = f"beside {fmean(kept):,.0f} that are kept (pairs of joints and frames)"
            texts = [f"{number:,}" for number in new]
            of_samples = _worst(texts, int(np.argmax(new))).replace("worst", "most")
            yield _row("new contacts", f"{fmean(new):,.0f}", note), of_samples

    def _verdict(self, limits: VariationLimits, *, is_near_worse: bool) -> Iterator[str]:
        """Say whether all limits hold, else which do not, the worst of each and where it is."""
        count = len(self.samples)
        exceeded = [self._exceeded(number, limits) for number in range(count)]
        beyond = sum(map(bool, exceeded))
        if not beyond:
            yield "; ".join(
                [
                    f"all within the {LIMITS}",
                    *["turns of the capture itself, named above, do not count"]
                    * bool(self.captured),
                    "errors of joints against the exact motion have none",
                    *["near distances have none, see below"] * is_near_worse,
                ]
            )
        elif count > 1:
            names = Counter(name for sample in exceeded for name in sample).most_common()
            texts = [f"{_label(name)} ({number})" for name, number in names]
            of_samples = f"all {count}" if beyond == count else f"{beyond} of {count}"
            yield f"{of_samples} samples beyond the {LIMITS}: {', '.join(texts)}"
            for name, _ in names:
                ratios = [sample.get(name, 0.0) for sample in exceeded]
                number = ratios.index(max(ratios))
                said = [self._beyond(name, n, limits, where=False) for n in range(count)]
                of_samples = samples_of(said, number)
                worst = "alike in" if of_samples == "all samples" else "worst in"
                yield f"  {worst} {of_samples}: {self._beyond(name, number, limits)}"
        else:
            yield f"beyond the {LIMITS}:"
            for name in sorted(exceeded[0], key=lambda name: -exceeded[0][name]):
                yield f"  {self._beyond(name, 0, limits)}"

    def _exceeded(self, number: int, limits: VariationLimits) -> dict[str, float]:
        """Return the measurements of a sample beyond their limits, with the ratio to it."""
        checks = self.checks[number] if self.checks else {}
        ratios = {name: checks[name].value / checks[name].limit for name in FRAME_MEASURES
                  if name in checks}  # fmt: skip
        own = {name: ratio for name, ratio in ratios.items() if ratio > 1}
        return exceeded_limits(self.samples[number], limits) | own

    def _beyond(
        self, name: str, number: int, limits: VariationLimits, *, where: bool = True
    ) -> str:
        """Say a measurement of a sample beyond its limit, and where it is worst."""
        check = self.checks[number].get(name) if self.checks else None
        if name in FRAME_MEASURES and check:
            measure = FRAME_MEASURES[name]
            text = f"{measure.label} {measure.text(check.value)}, {measure.limit_text(check)}"
        else:
            text = limit_text(name, self.samples[number][name], asdict(limits)[name])
        place = check.place if check else ""
        if self.places and not check:
            place = self.places[number].text(name)
        return f"{text} (worst: {place})" if place and where else text

    def _near_lines(self) -> Iterator[str]:
        """Say where near distances, which have no limit, change more than by mere scaling."""
        near, scaled = "near_distance_error", "near_distance_error_naive"
        losses = [sample[near] - sample[scaled] for sample in self.samples]
        if not self.places or max(losses) <= MIN_LOSS:
            return
        number, count = losses.index(max(losses)), len(losses)
        changed, naive = (
            MEASURES[name].text(self.samples[number][name]) for name in (near, scaled)
        )
        worse = [loss for loss in losses if loss > MIN_LOSS]
        most = samples_of([MEASURES[near].text(loss) for loss in losses], number)
        where = f" in {len(worse)} of {count} samples, most in {most}," if count > 1 else ""
        where = f" in all {count} samples, which are alike," if most == "all samples" else where
        yield (
            "near distances, which have no limit, change more than if each body is only scaled:"
            f"{where} by {changed} on average, if only scaled by {naive}; most between"
        )
        yield from (f"  {text}" for text in self.places[number].near_pairs())

    def _grip(self) -> str:
        """Say what judges a grip whose joints are not within the distance of contact."""
        if not self.near:
            return ""
        return (
            "; a grip whose joints are farther apart, as wrists are in files without hands, is "
            f"judged by near distances, those within {100 * self.near:.0f} cm"
        )


ALIKE = "alike in all samples"


def _worst(texts: Sequence[str], number: int) -> str:
    """Say which of several samples is the worst, or that they are alike; nothing of one."""
    of_samples = samples_of(texts, number)
    if of_samples in ("", "all samples"):
        return ALIKE if of_samples else ""
    return f"worst {texts[number]} in {of_samples}"


def _row(label: str, value: str, notes: str) -> str:
    """As those of ``measurement_lines``."""
    return f"  {label:<18}{value:>11}  {notes}"


def _label(name: str) -> str:
    return FRAME_MEASURES[name].label if name in FRAME_MEASURES else measure_label(name)


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
    people: Sequence[People],
    scales: Sequence[tuple[Scales, Scales]],
    settings: Settings,
    solved: Mapping[str, float] = WITHOUT_SOLVER,
    in_files: Sequence[People] = (),
) -> Measured:
    """Measure motions as they were written against the capture.

    Parameters
    ----------
    people : of each variation
    scales : of the bones of its two bodies, (E,) each
    solved : what a solver says of itself, by the names of ``interaction_mesh.Report``
    in_files : ``people`` with all joints and End Sites of BVH files; none of Parquet
    """
    points = [np.concatenate([p.motion for p in pair], axis=1, dtype=np.float64) for pair in people]
    supports = ground_supports(duo.scene, settings.support)
    bodies = np.stack([np.concatenate(pair) for pair in scales])
    motions = np.stack(points, axis=-1)
    found = measure_motions(duo.scene, settings, supports, bodies, motions)
    checked = check_people(duo, in_files or people, bodies, has_ends=bool(in_files))
    checks = tuple(
        {name: worst_of([one[name] for one in pair]) for name in pair[0]} for pair in checked
    )
    samples = tuple(
        {
            **solved,
            **{name: float(values[number]) for name, values in found.items()},
            "below_floor": checks[number]["below_floor"].value,
        }
        for number in range(len(people))
    )
    unscaled = without_common_scale(duo.scene, bodies, motions)
    a, b = measure_people(duo.scene, supports, *unscaled)
    apart = {name: float((b[name] - a[name]).mean()) for name in a}
    depths = [[one["below_floor"].value for one in pair] for pair in checked]
    apart["below_floor"] = fmean(of_b - of_a for of_a, of_b in depths)
    worse = {name: PEOPLE[int(by > 0)] for name, by in apart.items() if by}
    first, second = (person.motion for person in duo.people)
    nearest = float(min_point_distance(first, second).min())
    contacts = tuple(
        count_contacts(duo.scene, body, motion, settings.contact_distance)
        for body, motion in zip(bodies, points, strict=True)
    )
    worse_in = [{name: int(b[name][v] > a[name][v]) for name in a} for v in range(len(people))]
    places = tuple(
        Places(
            duo.scene,
            supports,
            body,
            motion,
            settings.contact_distance,
            settings.near_distance,
            in_whom,
        )
        for body, motion, in_whom in zip(
            unscaled[0], np.moveaxis(unscaled[1], -1, 0), worse_in, strict=True
        )
    )
    return Measured(
        samples,
        worse,
        nearest < settings.contact_distance,
        contacts,
        checks,
        tuple(captured_turn_lines(duo, in_files or people)),
        places,
        tuple(_displacement_lines(duo, people, scales)),
        settings.near_distance if nearest < settings.near_distance else 0.0,
    )


def _displacement_lines(
    duo: TwoPersonCapture,
    variations: Sequence[People],
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
    texts = [f"{100 * of_one.max():.1f}" for of_one in values]
    of_samples = samples_of(texts, number)
    alike = {"": "", "all samples": ", alike in all samples"}
    of_sample = alike.get(of_samples, f" of {of_samples}")
    time = own.times[frame] - own.times[0]
    return f" ({names[joint]} in frame {frame}, {time:.2f} s{of_sample})"


def write_variation_page(
    duo: TwoPersonCapture,
    variations: Sequence[People],
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


def _scene(label: str, people: People) -> Scene:
    frames = _shown_frames(people[0])
    times = people[0].times[frames] - people[0].times[0]
    shown = [replace(person, times=times, motion=person.motion[frames]) for person in people]
    return scene_of_people(label, shown)


def _shown_frames(person: PersonMotion) -> list[int]:
    """List the frames that the page plays: at most ``MAX_FPS``, from the start ``MAX_FRAMES``."""
    step = max(1, round(frame_rate(person.times) / MAX_FPS))
    return list(range(0, len(person.times), step))[:MAX_FRAMES]
