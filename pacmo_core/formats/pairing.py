"""Match files to people and sequences by their paths."""

import re
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from pacmo_core.data.limits import walk_files
from pacmo_core.formats.base import RawSequence
from pacmo_core.formats.tables import sequence_name


def unchanged_label(label: str) -> str:
    """Use the label in a file's name as the action."""
    return label


@dataclass(frozen=True, kw_only=True)
class PairRule:
    """How a dataset's paths encode the person and the sequence of a file.

    Parameters
    ----------
    pattern : regular expression over the whole path below the root, ``/`` between folders; its
        group ``person`` is the person, its other groups fill the templates
    persons : the values of group ``person``, in any case, for person a and for person b
    name, recording, action : templates (``str.format``) of the sequence's name, of the
        recording (kept together by a split) and of the label
    subjects : who person a and person b are
    label : from the filled ``action`` template to the action
    example : the paths of a pair, for messages
    """

    pattern: str
    persons: tuple[str, str]
    name: str
    recording: str
    action: str
    subjects: tuple[str, str]
    label: Callable[[str], str] = unchanged_label
    example: str = ""

    def sequence(self, path: str) -> tuple[int, RawSequence] | None:
        """Match a path: the person (0 or 1) and the sequence, without files yet."""
        match = re.fullmatch(self.pattern, path)
        persons = [person.lower() for person in self.persons]
        if match is None or match["person"].lower() not in persons:
            return None
        words = match.groupdict(default="")
        sequence = RawSequence(
            name=sequence_name(self.name.format(**words)),
            files=(),
            action=self.label(self.action.format(**words)),
            subjects=self.subjects,
            recording=self.recording.format(**words),
        )
        return persons.index(match["person"].lower()), sequence


def unpaired_text(rules: tuple[PairRule, ...]) -> str:
    """Say which names would have made a file one of a pair."""
    examples = " or ".join(rule.example for rule in rules if rule.example)
    return "no second person: " + (f"wanted names such as {examples}" if examples else "one file")


def matching_files(root: Path, file_name: str) -> list[Path]:
    """List the files below ``root`` whose names match a pattern, in any case, sorted by path.

    All but folders: what is no regular file is listed too, so that ingestion can give the reason.
    """
    pattern = re.compile(file_name, re.IGNORECASE | re.DOTALL)
    return sorted(file for file in walk_files(root) if pattern.fullmatch(file.name))


def unpaired_sequence(root: Path, file: Path) -> RawSequence:
    """Return the sequence of a file whose partner is missing; its name keeps the file's suffix."""
    path = file.relative_to(root).as_posix()
    return RawSequence(name=sequence_name(path), files=(file,), recording=path)


def pair_files(root: Path, file_name: str, rules: tuple[PairRule, ...]) -> list[RawSequence]:
    """List every sequence whose file names match, including those without a second person.

    Parameters
    ----------
    root : folder to search
    file_name : regular expression of the names of the format's files
    rules : the first that matches a path is used

    Returns
    -------
    Sequences by name: two files each, person a's first, or one file without a partner.
    """
    people: dict[tuple[RawSequence, PairRule], dict[int, Path]] = {}
    unpaired: list[Path] = []
    for file in matching_files(root, file_name):
        match = _match_rule(rules, file.relative_to(root).as_posix())
        if match is None or match[0] in people.setdefault(match[1:], {}):
            unpaired.append(file)
        else:
            people[match[1:]][match[0]] = file
    unpaired += [file for files in people.values() if len(files) == 1 for file in files.values()]
    pairs = [
        (replace(sequence, files=(files[0], files[1])), rule)
        for (sequence, rule), files in people.items()
        if len(files) == 2
    ]
    name_counts = Counter(sequence.name for sequence, _ in pairs)
    named = [
        replace(sequence, name=f"{sequence.name}.{'-'.join(rule.persons)}")
        if name_counts[sequence.name] > 1
        else sequence
        for sequence, rule in pairs
    ]
    unpaired_sequences = [unpaired_sequence(root, file) for file in unpaired]
    return sorted(named + unpaired_sequences, key=lambda sequence: sequence.name)


def _match_rule(rules: tuple[PairRule, ...], path: str) -> tuple[int, RawSequence, PairRule] | None:
    for rule in rules:
        match = rule.sequence(path)
        if match is not None:
            return *match, rule
    return None
