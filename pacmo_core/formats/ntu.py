"""NTU RGB+D and NTU RGB+D 120: Kinect v2 ``.skeleton`` files of 25 joints.

The camera's frame is kept: metres, y up, z away from the camera, x to the left of one who looks
out of it. It is right-handed: in the published files a body's left is on its left. The frame rate
is not in the file. Format: Shahroudy et al. (2016); Liu et al. (2019).
"""

import re
from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.skeleton import NTU25
from pacmo_core.formats.ntu_actions import ACTIONS
from pacmo_core.formats.ntu_bodies import fill, stitch, together, tracks, two_who_act
from pacmo_core.formats.ntu_text import parse
from pacmo_core.formats.raw import FormatError, RawSequence, Reading
from pacmo_core.formats.text import read_bytes

# Setup, camera, performer, replication, action.
_NAME = re.compile(r"(S\d{3})(C\d{3})(P\d{3})(R\d{3})(A\d{3})")


@dataclass(frozen=True, kw_only=True)
class Ntu:
    """NTU RGB+D, read with these settings.

    Parameters
    ----------
    fps : frames a second; Kinect v2 records 30
    max_gap : frames a body may be unseen and be filled in, or come back under a new number
    reach : metres from where a body was lost to where it may come back under a new number
    min_share : of the file's frames that a body is seen in, to be one of the two
    skip_lists : files, as published, that list samples with missing skeletons
    """

    fps: float
    max_gap: int
    reach: float
    min_share: float
    skip_lists: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not (self.fps > 0 and self.max_gap >= 0 and self.reach >= 0 and 0 < self.min_share <= 1):
            raise ValueError(
                f"fps must be > 0, max_gap and reach >= 0, min_share in (0, 1]; got {self.fps}, "
                f"{self.max_gap}, {self.reach}, {self.min_share}"
            )

    @cached_property
    def skipped(self) -> frozenset[str]:
        """The names on the lists.

        Raises
        ------
        OSError
            If there is no such list: samples known to be faulty must not slip in.
        """
        texts = [Path(name).read_text(encoding="utf-8") for name in self.skip_lists]
        return frozenset[str]().union(*map(read_skip_list, texts))

    def find(self, root: Path) -> list[RawSequence]:
        """List every ``.skeleton`` file under ``root``, those of one person too.

        A file name that occurs in several folders is told apart by the folder.
        """
        files = sorted(path for path in root.rglob("*.skeleton") if not path.is_dir())
        times = Counter(path.stem for path in files)
        return [
            _sequence(path.stem if times[path.stem] == 1 else _folder_name(path, root), path)
            for path in files
        ]

    def read(self, sequence: RawSequence) -> Reading:
        """Read one file; its two people are in the order in which they appear.

        Raises
        ------
        FormatError
            If the sample is listed as faulty, the text is, or two people cannot be followed.
        """
        (file,) = sequence.files
        if file.stem in self.skipped:
            raise FormatError(file, "listed among the samples with missing skeletons")
        seen = parse(read_bytes(file), file)
        people = stitch(tracks(seen), self.max_gap, self.reach)
        a, b = two_who_act(people, seen.n_frames, self.min_share, file)
        frames = together(a, b, file)
        person_a, n_a = fill(a, frames, self.max_gap, file)
        person_b, n_b = fill(b, frames, self.max_gap, file)
        times = np.arange(len(frames)) / self.fps
        return Reading(Interaction(NTU25, times, person_a, person_b), filled_frames=n_a + n_b)


def read_skip_list(text: str) -> frozenset[str]:
    """Take the sample names from a published list of samples with missing skeletons."""
    return frozenset(line.strip() for line in text.splitlines() if _NAME.fullmatch(line.strip()))


def _sequence(name: str, file: Path) -> RawSequence:
    """Label a file by its name, which names one performer; the other is only their partner."""
    match = _NAME.fullmatch(file.stem)
    if not match:
        return RawSequence(name, (file,), recording=name)
    setup, _, performer, replication, action = match.groups()
    return RawSequence(
        name=name,
        files=(file,),
        action=f"{action} {ACTIONS.get(action, '')}".strip(),
        subjects=(performer, ""),
        # Without the camera: three of them see one performance.
        recording=setup + performer + replication + action,
    )


def _folder_name(file: Path, root: Path) -> str:
    return file.relative_to(root).with_suffix("").as_posix()
