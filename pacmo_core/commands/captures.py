"""Two people of any capture: read, and written in the format that they came in."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.interaction import Interaction, Motion
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.formats.bvh import read_bvh
from pacmo_core.formats.bvh_pairs import BvhPairs
from pacmo_core.formats.registry import (
    DEFAULT_SETTINGS,
    ONE_PERSON_FORMATS,
    PersonMotion,
    format_of,
    read_partner,
    select_person,
)
from pacmo_core.formats.write_bvh import Rewritten, format_bvh, rewrite_bvh
from pacmo_core.interaction_mesh import Scene
from pacmo_core.project.workspace import CommandError
from pacmo_core.store.files import write_text
from pacmo_core.store.motions import read_motion, write_motions

MIN_BONE_LENGTH = 1e-3  # metres: a bone shorter than this all the time is none
PEOPLE = ("a", "b")


@dataclass(frozen=True)
class TwoPersonCapture:
    """Two people at the same instants.

    Parameters
    ----------
    name : of the capture
    files : it came from: one, or person a's and person b's
    settings : of BVH files
    people : person a and person b, bones without length left out
    """

    name: str
    files: tuple[Path, ...]
    settings: Mapping[str, Any]
    people: tuple[PersonMotion, PersonMotion]

    @property
    def scene(self) -> Scene:
        """Both as the solver wants them."""
        a, b = self.people
        fps = float(1 / np.median(np.diff(a.times)))
        return Scene((a.motion, b.motion), (a.skeleton, b.skeleton), fps)

    def moved(self, motions: tuple[Motion, Motion]) -> "TwoPersonCapture":
        """Give both other motions."""
        a, b = (
            replace(person, motion=motion)
            for person, motion in zip(self.people, motions, strict=True)
        )
        return replace(self, people=(a, b))


def read_two_people(
    files: tuple[Path, ...], form: str | None, settings: Mapping[str, Any], clip: str
) -> TwoPersonCapture:
    """Read one file of two people, or two of one.

    Raises
    ------
    CommandError
        If the files are not those of two people on one clock.
    """
    first = files[0]
    if first.suffix.lower() == ".parquet":
        if len(files) > 1 or not clip or settings or form:
            raise CommandError(f"{first}: wanted one file, --clip, and no option of other formats")
        pair = read_motion(first, clip)
        people = [select_person(pair, person, clip) for person in PEOPLE]
        return _make_capture(clip, files, settings, people)
    form = form or format_of(first)
    if (form in ONE_PERSON_FORMATS) != (len(files) == 2):
        wanted = (
            "one person: wanted two files" if form in ONE_PERSON_FORMATS else "two: wanted one file"
        )
        raise CommandError(f"{first}: a file of format {form} holds {wanted}; got {len(files)}")
    sources = files if len(files) == 2 else files * 2
    people = [
        read_partner(file, form, settings, person=None if len(files) == 2 else person, clip=clip)
        for file, person in zip(sources, PEOPLE, strict=True)
    ]
    return _make_capture(clip or first.stem, files, settings, people)


def is_parquet(out: Path) -> bool:
    """Whether a place that was asked for is one Parquet file, not a folder of that name."""
    return out.suffix.lower() == ".parquet" and not out.is_dir()


def check_output(duo: TwoPersonCapture, out: Path) -> None:
    """Refuse a place that says no format, or where the capture itself stands."""
    suffix = out.suffix.lower()
    if suffix not in (".parquet", ".bvh", "") and not out.is_dir():
        raise CommandError(f"{out}: wanted a .parquet or .bvh file, or a folder for BVH files")
    if suffix == ".parquet" and duo.people[0].skeleton != duo.people[1].skeleton:
        raise CommandError(
            f"{out}: Parquet holds two people of one skeleton; name a folder for BVH"
        )
    standing = {file.resolve() for file in duo.files}
    for file in [out] if suffix == ".parquet" else _output_files(duo, out):
        if file.resolve() in standing:
            raise CommandError(f"{out}: this would write over {file}; name another place")


def write_two_people(
    duo: TwoPersonCapture,
    scales: tuple[NDArray[np.float64], NDArray[np.float64]],
    label: str,
    out: Path,
) -> tuple[list[Path], float]:
    """Write both people; say where, and how far joints had to stay from their places, in metres.

    Parameters
    ----------
    scales : of each bone of either, which BVH files state as offsets
    label : what the variation is, for Parquet
    """
    a, b = duo.people
    if is_parquet(out):
        with write_motions(out, a.skeleton) as writer:
            times = a.times - a.times[0]
            pair = Interaction(a.skeleton, times, a.motion, b.motion)
            writer.add(f"{duo.name}~{label}", pair)
        return [out], 0.0
    files, max_error = _output_files(duo, out), 0.0
    for number, (person, scales_of_person) in enumerate(zip(duo.people, scales, strict=True)):
        if duo.files[0].suffix.lower() == ".bvh":
            file = duo.files[number]
            written, metres = _rewritten(file, duo.settings, person, scales_of_person)
            write_text(files[number], written.text)
            max_error = max(max_error, float(written.errors.max()) * metres)
        else:
            fps = float(1 / np.median(np.diff(person.times)))
            write_text(files[number], format_bvh(person.motion, fps, person.skeleton))
    return files, max_error


def _output_files(duo: TwoPersonCapture, out: Path) -> list[Path]:
    """Name the BVH files: as they came in, where it is a folder; so that they pair, otherwise."""
    if out.suffix.lower() == ".bvh" and not out.is_dir():
        return [out.with_name(f"{out.stem}_{person.upper()}.bvh") for person in PEOPLE]
    if duo.files[0].suffix.lower() == ".bvh":
        names = [file.name for file in duo.files]
        if names[0] != names[1]:
            return [out / name for name in names]
    stem = duo.name.replace("/", "_")
    return [out / f"{stem}_{person.upper()}.bvh" for person in PEOPLE]


def _rewritten(
    file: Path, settings: Mapping[str, Any], person: PersonMotion, own: NDArray[np.float64]
) -> tuple[Rewritten, float]:
    """Put a person back into the file's own tree, unit and axes."""
    bvh, pairs = read_bvh(file), BvhPairs(**{**DEFAULT_SETTINGS["bvh"], **settings})
    metres = pairs.metres(file)
    x, y, z = np.moveaxis(person.motion.astype(np.float64) / metres, -1, 0)
    files = np.stack((x, y, z) if pairs.up_axis == "y" else (x, -z, y), axis=-1)
    joints = [bvh.joints.index(name) for name in person.skeleton.joints]
    scales = np.ones(len(bvh.joints))
    bones = person.skeleton.bones[:, 1].tolist()
    for child, scale in zip(bones, own.tolist(), strict=True):
        scales[joints[child]] = scale
    for end in bvh.end_sites:
        scales[end] = scales[bvh.parents[end]]
    return rewrite_bvh(file, bvh, joints, files, scales), metres


def _make_capture(
    name: str, files: tuple[Path, ...], settings: Mapping[str, Any], people: list[PersonMotion]
) -> TwoPersonCapture:
    a, b = (_without_zero_bones(person) for person in people)
    text = " and ".join(str(file) for file in files)
    if len(a.times) != len(b.times):
        raise CommandError(f"{text}: {len(a.times)} frames of one, {len(b.times)} of the other")
    if not np.allclose(a.times, b.times, rtol=1e-4):
        raise CommandError(f"{text}: not on one clock; {a.times[-1]:g} s and {b.times[-1]:g} s")
    return TwoPersonCapture(name, files, settings, (a, b))


def _without_zero_bones(person: PersonMotion) -> PersonMotion:
    """Leave out joints that never leave their parent, as some programs write them."""
    body = person.skeleton
    parent, child = body.bones.T
    lengths = np.linalg.norm(person.motion[:, child] - person.motion[:, parent], axis=-1)
    empty = child[(lengths < MIN_BONE_LENGTH).all(axis=0)]
    if not len(empty):
        return person
    kept: Skeleton = body.without(body.joints[joint] for joint in empty)
    rows = body.indices(kept.joints)
    return PersonMotion(kept, person.times, np.ascontiguousarray(person.motion[:, rows]))
