"""Raw formats by name, and one person read from a capture of any format (the partner)."""

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.interaction import Interaction, Motion
from pacmo_core.data.skeleton import NTU25, Skeleton
from pacmo_core.formats.base import Format, FormatError, RawSequence, read_capture
from pacmo_core.formats.bvh_pairs import BvhPairs
from pacmo_core.formats.cmu import CMU_FPS, Cmu
from pacmo_core.formats.duetdance import DuetDance
from pacmo_core.formats.expi import Expi
from pacmo_core.formats.interhuman import InterHuman
from pacmo_core.formats.ntu import (
    Ntu,
    interpolate_gaps,
    link_tracks,
    make_tracks,
    parse_skeleton_text,
)
from pacmo_core.formats.sbu import Sbu
from pacmo_core.formats.table import Table, has_person_b
from pacmo_core.formats.tables import read_bytes

# Each a frozen dataclass of settings with the methods of Format.
FORMATS: dict[str, type[Any]] = {
    "ntu": Ntu,
    "sbu": Sbu,
    "duetdance": DuetDance,
    "expi": Expi,
    "bvh": BvhPairs,
    "cmu": Cmu,
    "interhuman": InterHuman,
    "table": Table,
}


def open_format(name: str, settings: Mapping[str, Any]) -> Format:
    """Make a reader of a format from its settings.

    Parameters
    ----------
    name : a key of ``FORMATS``
    settings : the fields of its class, those with a default optional

    Raises
    ------
    KeyError
        If there is no such format.
    ValueError
        If a setting is unknown, missing, or has a value that the format refuses.
    """
    check_setting_names(name, settings)
    reader: Format = FORMATS[name](**settings)
    return reader


def check_setting_names(name: str, settings: Mapping[str, Any]) -> None:
    """Check that there is such a format and that these are settings of it.

    Raises
    ------
    KeyError, ValueError
        As ``open_format``.
    """
    if name not in FORMATS:
        raise KeyError(f"no format {name!r}; there are {', '.join(FORMATS)}")
    required_by_name = {field.name: field.default is MISSING for field in fields(FORMATS[name])}
    unknown = sorted(set(settings) - set(required_by_name))
    missing = [
        setting
        for setting, required in required_by_name.items()
        if required and setting not in settings
    ]
    if unknown or missing:
        wrong = [f"no setting {', '.join(unknown)}"] if unknown else []
        wrong += [f"missing {', '.join(missing)}"] if missing else []
        raise ValueError(
            f"format {name} has the settings {', '.join(required_by_name)}; {'; '.join(wrong)}"
        )


FORMAT_OF_SUFFIX = {
    ".bvh": "bvh",
    ".amc": "cmu",
    ".skeleton": "ntu",
    ".tsv": "expi",
    ".npy": "interhuman",
    ".mat": "duetdance",
    ".npz": "table",
    ".parquet": "table",  # unless it is a file of clips
    ".csv": "table",
}
ONE_PERSON_FORMATS = ("bvh", "cmu", "duetdance", "interhuman")  # a file; the others hold two
# Settings that the datasets' publications state and their files do not.
DEFAULT_SETTINGS: dict[str, dict[str, Any]] = {
    "bvh": {
        "preset": "pair",
        "unit": None,
        "up": None,
        "fps": None,
        "end_sites": False,
        "skip_frames": 0,
        "max_root_distance": None,
    },
    "cmu": {"fps": CMU_FPS},
    "duetdance": {"fps": 25.0},
    "expi": {"fps": 25.0, "up": "z"},
    "interhuman": {"fps": 30.0, "up": "z"},
    "ntu": {"fps": 30.0, "max_gap": 5, "max_link_distance": 0.3, "min_visible_share": 0.5},
    "sbu": {"fps": 15.0},
    "table": {},
}


@dataclass(frozen=True)
class PersonMotion:
    """One person's motion.

    Parameters
    ----------
    skeleton : the joints
    times : (T,) float64, seconds
    motion : (T, J, 3) float32, metres, y up
    """

    skeleton: Skeleton
    times: NDArray[np.float64]
    motion: Motion

    def select_joints(self, skeleton: Skeleton) -> "PersonMotion":
        """Select the joints of a skeleton, by name and in its order.

        Raises
        ------
        ValueError
            If some are missing.
        """
        missing = [joint for joint in skeleton.joints if joint not in self.skeleton.joints]
        if missing:
            raise ValueError(
                f"the model's skeleton {skeleton.name} has joints that are missing "
                f"in the capture ({self.skeleton.name}): {', '.join(missing)}"
            )
        selected = self.skeleton.indices(skeleton.joints)
        return PersonMotion(skeleton, self.times, np.ascontiguousarray(self.motion[:, selected]))


def format_of(file: Path) -> str:
    """Infer the format from the file's suffix.

    Raises
    ------
    ValueError
        If the suffix belongs to no format.
    """
    if file.suffix.lower() not in FORMAT_OF_SUFFIX:
        of_name = "; files of this name are those of sbu and duetdance"
        named = of_name if file.name == "skeleton_pos.txt" else ""
        raise ValueError(
            f"{file.name}: its suffix belongs to no format; "
            f"wanted a format (--format), one of {', '.join(DEFAULT_SETTINGS)}{named}"
        )
    return FORMAT_OF_SUFFIX[file.suffix.lower()]


def read_partner(
    file: Path, format_name: str, settings: Mapping[str, Any], *, person: str | None, clip: str
) -> PersonMotion:
    """Read one person.

    Parameters
    ----------
    file : a capture
    format_name : a key of ``DEFAULT_SETTINGS``
    settings : overrides of ``DEFAULT_SETTINGS``
    person : ``a`` or ``b`` of a file of two people; None where there is one
    clip : the variable of a ``.mat`` file

    Raises
    ------
    FormatError
        If the file is broken.
    ValueError
        If a setting is wrong, or the file holds two people and ``person`` is None.
    KeyError
        If there is no such format.
    """
    if format_name not in DEFAULT_SETTINGS:
        raise KeyError(f"no format {format_name!r}; there are {', '.join(DEFAULT_SETTINGS)}")
    reader = open_format(
        format_name,
        {**DEFAULT_SETTINGS[format_name], **_fps_by_subject(file, format_name, settings)},
    )
    if single := read_single(file, reader):
        return single
    if format_name in ONE_PERSON_FORMATS:
        # Every reader returns two people: the same file is given twice.
        sequence = RawSequence(clip or file.stem, (file, file))
        return select_person(read_capture(reader, sequence).interaction, "a", file.name)
    return select_person(
        read_capture(reader, RawSequence(file.stem, (file,))).interaction, person, file.name
    )


def holds_one_person(file: Path, format_name: str, settings: Mapping[str, Any]) -> bool:
    """Whether a file of a format that can hold two people holds one.

    Raises
    ------
    FormatError
        If the file is broken.
    """
    if format_name == "table":
        return not has_person_b(file)
    reader = open_format(format_name, {**DEFAULT_SETTINGS[format_name], **settings})
    return read_single(file, reader) is not None


def read_single(file: Path, reader: Format) -> PersonMotion | None:
    """Read the one person of a file that could hold two; None where there are two.

    Raises
    ------
    FormatError
        If the file is broken.
    """
    if isinstance(reader, Ntu):
        return _read_single_body(file, reader)
    if isinstance(reader, Table) and (single := reader.read_single(file)):
        return PersonMotion(*single)
    return None


def select_person(interaction: Interaction, person: str | None, name: str) -> PersonMotion:
    """Select one of two people.

    Raises
    ------
    ValueError
        If ``person`` is neither.
    """
    if person not in ("a", "b"):
        got = person or "neither"
        raise ValueError(f"{name} holds two people: wanted one (--person), a or b; got {got}")
    motion = interaction.person_a if person == "a" else interaction.person_b
    return PersonMotion(interaction.skeleton, interaction.times, motion)


def _fps_by_subject(file: Path, format_name: str, settings: Mapping[str, Any]) -> Mapping[str, Any]:
    """CMU's frame rates are by subject, the first word of a file's name."""
    if format_name != "cmu" or "fps" not in settings:
        return settings
    return {**settings, "fps": {file.stem.partition("_")[0]: settings["fps"]}}


def _read_single_body(file: Path, ntu: Ntu) -> PersonMotion | None:
    """Read an NTU file in which just one body is visible long enough; None where there are more."""
    detections = parse_skeleton_text(read_bytes(file), file)
    people = link_tracks(make_tracks(detections), ntu.max_gap, ntu.max_link_distance)
    visible = [
        body for body in people if len(body.frame) >= ntu.min_visible_share * detections.n_frames
    ]
    if len(visible) != 1:
        return None
    frames = np.arange(visible[0].frame[0], visible[0].frame[-1] + 1)
    if len(frames) < 2:
        raise FormatError(file, f"wanted two frames or more; got {len(frames)}")
    motion, _ = interpolate_gaps(visible[0], frames, ntu.max_gap, file)
    return PersonMotion(NTU25, np.arange(len(frames)) / ntu.fps, motion)
