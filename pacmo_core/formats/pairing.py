"""Which file belongs to which person of which sequence, told by names alone."""

import re
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from pacmo_core.formats.raw import RawSequence
from pacmo_core.formats.tables import sequence_name


def as_written(label: str) -> str:
    """Take the label in a file's name as the action."""
    return label


@dataclass(frozen=True, kw_only=True)
class PairRule:
    """How a data set's paths say who is in a file and with whom.

    Parameters
    ----------
    pattern : regular expression over the whole path below the root, ``/`` between folders; its
        group ``person`` says whose file it is, its other groups fill the templates
    persons : what group ``person`` says for person a and for person b
    name, recording, action : templates (``str.format``) of the sequence's name, of what a split
        by recording keeps together, and of the label
    subjects : who person a and person b are
    label : from the filled ``action`` template to the action
    """

    pattern: str
    persons: tuple[str, str]
    name: str
    recording: str
    action: str
    subjects: tuple[str, str]
    label: Callable[[str], str] = as_written

    def sequence(self, path: str) -> tuple[int, RawSequence] | None:
        """Tell whose file ``path`` is (0 or 1) and its sequence, yet without files."""
        match = re.fullmatch(self.pattern, path)
        if match is None or match["person"] not in self.persons:
            return None
        words = match.groupdict(default="")
        sequence = RawSequence(
            name=sequence_name(self.name.format(**words)),
            files=(),
            action=self.label(self.action.format(**words)),
            subjects=self.subjects,
            recording=self.recording.format(**words),
        )
        return self.persons.index(match["person"]), sequence


def matching_files(root: Path, file_name: str) -> list[Path]:
    """List the files below ``root`` whose names match a pattern, in any case, sorted by path."""
    files = (file for file in root.rglob("*") if re.fullmatch(file_name, file.name, re.IGNORECASE))
    return sorted(file for file in files if file.is_file())


def lone_sequence(root: Path, file: Path) -> RawSequence:
    """Describe a file that has no place in a pair; its name keeps the file's ending."""
    path = file.relative_to(root).as_posix()
    return RawSequence(name=sequence_name(path), files=(file,), recording=path)


def pair_files(root: Path, file_name: str, rules: tuple[PairRule, ...]) -> list[RawSequence]:
    """List every sequence whose files' names match, those without a second person too.

    Parameters
    ----------
    root : folder to look through
    file_name : regular expression of the names of the format's files
    rules : the first that fits a path speaks for it

    Returns
    -------
    Sequences by name: two files each, person a's first, or one file that found no partner.
    """
    people: dict[tuple[RawSequence, PairRule], dict[int, Path]] = {}
    lone: list[Path] = []
    for file in matching_files(root, file_name):
        place = _place(rules, file.relative_to(root).as_posix())
        if place is None or place[0] in people.setdefault(place[1:], {}):
            lone.append(file)
        else:
            people[place[1:]][place[0]] = file
    lone += [file for files in people.values() if len(files) == 1 for file in files.values()]
    pairs = [
        (replace(sequence, files=(files[0], files[1])), rule)
        for (sequence, rule), files in people.items()
        if len(files) == 2
    ]
    taken = Counter(sequence.name for sequence, _ in pairs)
    named = [
        replace(sequence, name=f"{sequence.name}.{'-'.join(rule.persons)}")
        if taken[sequence.name] > 1
        else sequence
        for sequence, rule in pairs
    ]
    alone = [lone_sequence(root, file) for file in lone]
    return sorted(named + alone, key=lambda sequence: sequence.name)


def _place(rules: tuple[PairRule, ...], path: str) -> tuple[int, RawSequence, PairRule] | None:
    for rule in rules:
        found = rule.sequence(path)
        if found is not None:
            return *found, rule
    return None
