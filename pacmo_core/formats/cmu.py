"""CMU motion capture (mocap.cs.cmu.edu): pairs of ASF and AMC files of two subjects.

The files state neither action label nor frame rate; both are taken from the index of the database.
"""

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from pacmo_core.data.skeleton import Skeleton, mirror_by_name
from pacmo_core.formats.acclaim import read_amc
from pacmo_core.formats.base import (
    FormatError,
    Person,
    RawSequence,
    Reading,
    check_fps,
    pair_people,
)
from pacmo_core.formats.pairing import PairRule, pair_files, unpaired_text

# Subjects captured together: the same trial number is the same recording.
CMU_PAIRS = (("18", "19"), ("20", "21"), ("22", "23"), ("33", "34"), ("60", "61"))

# Frames a second, for the setting ``fps`` of ``Cmu``.
CMU_FPS = {
    **dict.fromkeys(("18", "19", "20", "21", "22", "23"), 120.0),
    **dict.fromkeys(("33", "34", "60", "61"), 60.0),
}

_LABELS = {
    "18": "1 walk, shake hands|2 walk, shake hands|3 A pulls B; B resists|4 A pulls B; B resists"
    "|5 A pulls B by the elbow; B resists|6 A pulls B by the elbow; B resists"
    "|7 navigate busy sidewalk; A leads the way, takes B by the arm"
    "|8 conversation - explain with hand gestures"
    "|9 conversation - explain with hand gestures, walk|10 quarrel - angry hand gestures"
    "|11 quarrel - angry hand gestures|12 friends meet, hang out; A sits, B joins A"
    "|13 run, scramble for last seat|14 run, scramble for last seat|15 chicken dance",
    "20": "1 chicken dance|2 link arms, walk|3 link arms, walk|4 synchronized walk"
    "|5 synchronized walk|6 soldiers march|7 soldiers march|8 zombie march"
    "|9 nursery rhyme - ring around the rosey|10 360-degree two-person whip"
    "|11 high-five, walk|12 low-five, walk|13 blind man's bluff (blindfold tag)",
    "22": "1 B sits; A pulls up B|2 A sits; B pulls up A"
    "|3 A sits, holds face in hands; B kneels, comforts A"
    "|4 B comforts A, puts one hand on A's shoulder"
    "|5 A comforts B, puts both hands on B's shoulders"
    "|6 B comforts A, puts both hands on A's shoulders"
    "|7 A comforts B, puts one hand on B's shoulder|8 hold hands, swing arms, walk"
    "|9 A gives B a shoulder rub; B sits, A stands|10 A shelters B, a younger child, from harm"
    "|11 B shelters A, a younger child, from harm|12 A stumbles into B"
    "|13 A passes soda to B; both drink|14 alternating squats|15 alternating jumping jacks"
    "|16 synchronized jumping jacks|17 rush up, arm wrestle"
    "|18 A stares down B, leans with hands on high stool"
    "|19 B stares down A, leans with hands on high stool"
    "|20 violence - A picks up high stool, threatens to strike B"
    "|21 conversation - B pounds high stool, points at A"
    "|22 walk; B catches keys thrown by A|23 walk; A catches keys thrown by B"
    "|24 walk; B catches wallet thrown by A|25 walk; A catches wallet thrown by B",
    "33": "1 football - throw, catch|2 football - throw, catch, jump around",
    "60": "|".join(f"{trial} salsa dance" for trial in range(1, 16)),
}

CMU_LABELS = {
    f"{subject}_{int(number):02d}": label
    for subject, labels in _LABELS.items()
    for number, _, label in (entry.partition(" ") for entry in labels.split("|"))
}


def trial_label(trial: str) -> str:
    """Return the label of a trial of person a (``18_01``) in the index; empty if it has none."""
    return CMU_LABELS.get(trial, "")


PAIR_RULES = tuple(
    PairRule(
        pattern=rf"(?P<folder>(?:.*/)??)(?:(?:{a}|{b})/)?(?P<person>{a}|{b})_(?P<trial>\d+)"
        r"\.(?i:amc)",
        persons=(a, b),
        name=f"{{folder}}{a}_{b}_{{trial}}",
        recording=f"{a}_{{trial}}",
        action=f"{a}_{{trial}}",
        subjects=(a, b),
        label=trial_label,
        example=f"{a}_01.amc and {b}_01.amc",
    )
    for a, b in CMU_PAIRS
)


@dataclass(frozen=True, kw_only=True)
class Cmu:
    """ASF and AMC files of two subjects a trial.

    Parameters
    ----------
    fps : frames a second by subject; the files do not state it. ``CMU_FPS`` has the
        rates of the index
    """

    fps: Mapping[str, float]

    def __post_init__(self) -> None:
        for rate in self.fps.values():
            check_fps(rate)

    def find(self, root: Path) -> list[RawSequence]:
        """List every trial of two subjects, and every AMC file without the other's."""
        sequences = pair_files(root, r".*\.amc", PAIR_RULES)
        return [
            replace(sequence, files=sequence.files + _skeleton_files(sequence.files))
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
        if not motions:
            raise FormatError(sequence.files[0], "no motion: wanted the name of an AMC file")
        people = [self._person(file) for file in motions]
        if len(people) == 1:
            raise FormatError(motions[0], unpaired_text(PAIR_RULES))
        return pair_people(people)

    def _person(self, file: Path) -> Person:
        asf_file, subject = skeleton_file(file), _subject(file)
        if subject not in self.fps:
            reason = f"no fps given for subject {subject!r}; the file states none"
            raise FormatError(file, f"{reason}: give --from-fps, or the setting fps")
        amc = read_amc(asf_file, file)
        joints = amc.asf.joints
        skeleton = Skeleton("cmu", joints, amc.asf.parents, mirror_by_name(joints))
        return Person(file, skeleton, amc.positions(), self.fps[subject])


def skeleton_file(amc_file: Path) -> Path:
    """Return the ASF file of a subject: in the folder of the motion, named by the subject."""
    return amc_file.parent / f"{_subject(amc_file)}.asf"


def _subject(amc_file: Path) -> str:
    return amc_file.stem.partition("_")[0]


def _skeleton_files(files: tuple[Path, ...]) -> tuple[Path, ...]:
    return tuple(file for file in map(skeleton_file, files) if os.path.lexists(file))
