"""One person out of a capture, whatever the format: the partner to react to."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.interaction import Interaction, Motion
from pacmo_core.data.skeleton import NTU25, Skeleton
from pacmo_core.formats.cmu_trials import CMU_FPS
from pacmo_core.formats.ntu import Ntu
from pacmo_core.formats.ntu_bodies import fill, stitch, tracks
from pacmo_core.formats.ntu_text import parse
from pacmo_core.formats.raw import FormatError, RawSequence
from pacmo_core.formats.registry import open_format
from pacmo_core.formats.text import read_bytes

ENDINGS = {
    ".bvh": "bvh",
    ".amc": "cmu",
    ".skeleton": "ntu",
    ".tsv": "expi",
    ".npy": "interhuman",
    ".mat": "duetdance",
}
ONE_PERSON = ("bvh", "cmu", "duetdance", "interhuman")  # a file; the others hold two
# What the sets' publications say and their files do not.
PUBLISHED: dict[str, dict[str, Any]] = {
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
    "ntu": {"fps": 30.0, "max_gap": 5, "reach": 0.3, "min_share": 0.5},
    "sbu": {"fps": 15.0},
}


@dataclass(frozen=True)
class Capture:
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

    def of(self, skeleton: Skeleton) -> "Capture":
        """Keep the joints of a skeleton, by name and in its order.

        Raises
        ------
        ValueError
            If some are missing.
        """
        missing = [joint for joint in skeleton.joints if joint not in self.skeleton.joints]
        if missing:
            raise ValueError(
                f"the model's skeleton {skeleton.name} has joints that the capture "
                f"({self.skeleton.name}) lacks: {', '.join(missing)}"
            )
        kept = self.skeleton.indices(skeleton.joints)
        return Capture(skeleton, self.times, np.ascontiguousarray(self.motion[:, kept]))


def format_of(file: Path) -> str:
    """Tell the format by the file's ending.

    Raises
    ------
    ValueError
        If it does not tell.
    """
    if file.suffix.lower() not in ENDINGS:
        raise ValueError(
            f"{file.name}: its ending does not tell its format; name one of {', '.join(PUBLISHED)}"
        )
    return ENDINGS[file.suffix.lower()]


def read_partner(
    file: Path, form: str, settings: Mapping[str, Any], *, person: str | None, clip: str
) -> Capture:
    """Read one person.

    Parameters
    ----------
    file : a capture
    form : a key of ``PUBLISHED``
    settings : what differs from ``PUBLISHED``
    person : ``a`` or ``b`` of a file of two people; None where there is one
    clip : the variable of a ``.mat`` file

    Raises
    ------
    FormatError
        If the file is broken.
    ValueError
        If a setting is wrong, or the file holds two people and none is named.
    KeyError
        If there is no such format.
    """
    if form not in PUBLISHED:
        raise KeyError(f"no format {form!r}; there are {', '.join(PUBLISHED)}")
    opened = open_format(form, {**PUBLISHED[form], **_by_subject(file, form, settings)})
    if isinstance(opened, Ntu) and (alone := _one_body(file, opened)):
        return alone
    if form in ONE_PERSON:
        # Every format pairs people; a person paired with himself is one.
        sequence = RawSequence(clip or file.stem, (file, file))
        return one_of(opened.read(sequence).interaction, "a", file.name)
    return one_of(opened.read(RawSequence(file.stem, (file,))).interaction, person, file.name)


def one_of(interaction: Interaction, person: str | None, name: str) -> Capture:
    """Take one of two people.

    Raises
    ------
    ValueError
        If none is named.
    """
    if person not in ("a", "b"):
        raise ValueError(f"{name} holds two people: name the partner, a or b; got {person}")
    motion = interaction.person_a if person == "a" else interaction.person_b
    return Capture(interaction.skeleton, interaction.times, motion)


def _by_subject(file: Path, form: str, settings: Mapping[str, Any]) -> Mapping[str, Any]:
    """CMU's rates go by subject, which is the first word of a file's name."""
    if form != "cmu" or "fps" not in settings:
        return settings
    return {**settings, "fps": {file.stem.partition("_")[0]: settings["fps"]}}


def _one_body(file: Path, ntu: Ntu) -> Capture | None:
    """Follow the body of an NTU file that shows just one long enough."""
    seen = parse(read_bytes(file), file)
    people = stitch(tracks(seen), ntu.max_gap, ntu.reach)
    stay = [body for body in people if len(body.frame) >= ntu.min_share * seen.n_frames]
    if len(stay) != 1:
        return None
    frames = np.arange(stay[0].frame[0], stay[0].frame[-1] + 1)
    if len(frames) < 2:
        raise FormatError(file, f"wanted two frames or more; got {len(frames)}")
    motion, _ = fill(stay[0], frames, ntu.max_gap, file)
    return Capture(NTU25, np.arange(len(frames)) / ntu.fps, motion)
