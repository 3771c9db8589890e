"""CMU Graphics Lab motion capture in its own form: an ASF skeleton a subject, an AMC file a trial.

Published at mocap.cs.cmu.edu: ``<subject>/<subject>.asf``, ``<subject>/<subject>_<trial>.amc``.
Two people captured together are two subjects; the same trial number is the same instant.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from pacmo_core.data.skeleton import Skeleton, mirror_by_name
from pacmo_core.formats.acclaim import read_amc
from pacmo_core.formats.cmu_trials import CMU_PAIRS, trial_label
from pacmo_core.formats.pairing import PairRule, pair_files
from pacmo_core.formats.people import Person, check_fps, join
from pacmo_core.formats.raw import FormatError, RawSequence, Reading

RULES = tuple(
    PairRule(
        pattern=rf"(?P<folder>(?:.*/)??)(?:(?:{a}|{b})/)?(?P<person>{a}|{b})_(?P<trial>\d+)"
        r"\.(?i:amc)",
        persons=(a, b),
        name=f"{{folder}}{a}_{b}_{{trial}}",
        recording=f"{a}_{{trial}}",
        action=f"{a}_{{trial}}",
        subjects=(a, b),
        label=trial_label,
    )
    for a, b in CMU_PAIRS
)


@dataclass(frozen=True, kw_only=True)
class Cmu:
    """ASF and AMC files of two subjects a trial.

    Parameters
    ----------
    fps : frames a second by subject; the files do not state it. ``cmu_trials.CMU_FPS`` holds
        what the index says
    """

    fps: Mapping[str, float]

    def __post_init__(self) -> None:
        for rate in self.fps.values():
            check_fps(rate)

    def find(self, root: Path) -> list[RawSequence]:
        """List every trial of two subjects, and every AMC file without the other's."""
        sequences = pair_files(root, r".*\.amc", RULES)
        return [
            replace(sequence, files=sequence.files + _skeletons(sequence.files))
            for sequence in sequences
        ]

    def read(self, sequence: RawSequence) -> Reading:
        """Read both people.

        Raises
        ------
        FormatError
            If a file is broken (said first), one is missing, or the two do not match.
        """
        motions = [file for file in sequence.files if file.suffix.lower() == ".amc"]
        return join([self._person(file) for file in motions])

    def _person(self, file: Path) -> Person:
        asf_file, subject = skeleton_file(file), _subject(file)
        if subject not in self.fps:
            raise FormatError(file, f"no fps given for subject {subject!r}; the file states none")
        amc = read_amc(asf_file, file)
        joints = amc.asf.joints
        skeleton = Skeleton("cmu", joints, amc.asf.parents, mirror_by_name(joints))
        return Person(file, skeleton, amc.positions(), self.fps[subject])


def skeleton_file(amc_file: Path) -> Path:
    """Name the ASF file of a subject: beside the motion, under the subject's number."""
    return amc_file.parent / f"{_subject(amc_file)}.asf"


def _subject(amc_file: Path) -> str:
    return amc_file.stem.partition("_")[0]


def _skeletons(files: tuple[Path, ...]) -> tuple[Path, ...]:
    return tuple(file for file in map(skeleton_file, files) if file.is_file())
