"""Cut long recordings into clips, and assign every clip to a split: train, validation or test.

The split is a hash of what must stay together (a recording, a pair, a person), never a position in
a shuffled list: a new capture does not move any other clip. Therefore the shares hold on average,
not exactly.

Fold k of a hashed split tests the k-th interval of ``[0, 1)``, each of width ``test_share``: no
two folds test the same clip.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from itertools import pairwise
from typing import Literal

import numpy as np

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.names import clip_name

METHODS = (
    *("auto", "clip", "recording", "pair", "person"),
    *("listed", "listed_people", "listed_recordings"),
)


@dataclass(frozen=True)
class ClipOrigin:
    """What a test clip must not have in common with a training clip.

    Parameters
    ----------
    clip, recording : names
    people : its people, as far as the dataset names them
    """

    clip: str
    recording: str
    people: tuple[str, ...]

    @property
    def pair(self) -> str:
        """The people as one name, the same in either order."""
        return "+".join(sorted(self.people))


@dataclass(frozen=True)
class SplitRule:
    """How clips are assigned to splits.

    Parameters
    ----------
    method : ``clip`` (the random split of the papers; the same people are in training and test),
        ``recording``, ``pair``, ``person`` (nobody is in both training and test), ``listed`` (pairs
        of ``test_pairs``), ``listed_people`` (people of ``test_people``; nobody is in both),
        ``listed_recordings`` (those of ``test_recordings``), or ``auto``: ``person`` if at least
        ``min_people`` people are known, else ``recording``
    test_share, validation_share : expected shares of what is hashed
    validation_by : ``recording``, or ``clip`` if training needs all recordings
    min_people : for ``auto``
    test_pairs : for ``listed``, the pairs that each fold tests, such as the published folds:
        ``s01+s02``, the people in the order of the dataset
    test_people : for ``listed_people``, the people that each fold tests
    test_recordings : for ``listed_recordings``, patterns of the recordings that each fold tests,
        such as ``variation_*``; a recording has the name of its file, unless the dataset or
        ``captures.csv`` says otherwise
    random_seed : part of the hash
    """

    method: str
    test_share: float
    validation_share: float
    validation_by: str
    min_people: int
    test_pairs: tuple[tuple[str, ...], ...]
    test_people: tuple[tuple[str, ...], ...]
    test_recordings: tuple[tuple[str, ...], ...]
    random_seed: int

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise ValueError(f"method must be one of {', '.join(METHODS)}; got {self.method}")
        if self.validation_by not in ("recording", "clip"):
            raise ValueError(f"validation_by must be recording or clip; got {self.validation_by}")
        if not 0 < self.test_share < 1 or not 0 <= self.validation_share < 1:
            raise ValueError(
                f"shares must lie between 0 and 1; got test {self.test_share}, "
                f"validation {self.validation_share}"
            )

    @property
    def listed(self) -> tuple[tuple[str, ...], ...]:
        """The pairs, people or patterns that each fold tests, for a method that lists them."""
        return {
            "listed": self.test_pairs,
            "listed_people": self.test_people,
            "listed_recordings": self.test_recordings,
        }.get(self.method, ())

    def check_fold(self, fold: int) -> None:
        """Check that the rule has a fold of this number.

        Raises
        ------
        ValueError
            If the fold is not listed, or does not fit into what is hashed.
        """
        listed = self.method.startswith("listed")
        n_folds = len(self.listed) if listed else int(1 / self.test_share + ROUNDING)
        if not 1 <= fold <= n_folds:
            reason = "are listed" if listed else f"of test_share {self.test_share} fit into 1"
            raise ValueError(f"fold must be 1 to {n_folds}, as many as {reason}; got {fold}")


Split = Literal["train", "validation", "test", "dropped"]
MAX_SHOWN = 30  # names in a message
ROUNDING = 1e-9  # so that five folds of a share of 0.2 fit into 1


def check_clip_seconds(seconds: float) -> None:
    """Raise ValueError unless recordings can be cut into windows of ``seconds``."""
    if not seconds > 0:
        raise ValueError(f"clip_seconds must be > 0; got {seconds}")


def window_edges(n_frames: int, fps: float, seconds: float) -> list[tuple[int, int]]:
    """Cut a recording into equal windows of about ``seconds``, without overlap.

    A recording of less than one and a half windows is one window; no window has fewer than two
    frames, unless the recording has.

    Returns
    -------
    (start, stop) frames of each window, stop exclusive
    """
    n_windows = max(1, min(round(n_frames / fps / seconds), n_frames // 2))
    edges = np.linspace(0, n_frames, n_windows + 1).round().astype(int).tolist()
    return list(pairwise(edges))


def cut_sequence(
    name: str, sequence: Interaction, seconds: float
) -> list[tuple[str, int, Interaction]]:
    """Cut a sequence into clips of about ``seconds``.

    Returns
    -------
    (name, start frame, clip) of each clip, sorted by name
    """
    edges = window_edges(len(sequence.times), sequence.fps, seconds)
    return [
        (clip_name(name, number, len(edges)), start, sequence.frames(start, stop))
        for number, (start, stop) in enumerate(edges)
    ]


def resolve_method(origins: Sequence[ClipOrigin], rule: SplitRule) -> str:
    """Return the method, ``auto`` replaced by what it means for these clips."""
    if rule.method != "auto":
        return rule.method
    people = {person for origin in origins for person in origin.people}
    all_named = all(origin.people for origin in origins)
    return "person" if all_named and len(people) >= rule.min_people else "recording"


def assign_splits(origins: Sequence[ClipOrigin], rule: SplitRule, fold: int) -> dict[str, Split]:
    """Assign every clip to a split.

    Validation clips are taken from training by recording or by clip, whatever the method: they
    select checkpoints and are no statement about new people. Split by person, a clip of one
    training and one test person is ``dropped``.

    Returns
    -------
    split of each clip by name, in the fold of that number, counted from 1

    Raises
    ------
    ValueError
        If the rule has no such fold or lists a pair, person or recording that no clip has; if it is
        by person and a clip names none; or if no clip is left to train on or to test on.
    """
    rule.check_fold(fold)
    method = resolve_method(origins, rule)
    _check_listed(origins, method, rule, fold)
    splits = {origin.clip: _split(origin, method, rule, fold) for origin in origins}
    for split in ("train", "test"):
        if split not in splits.values():
            raise ValueError(
                f"split by {method} with random_seed {rule.random_seed} leaves no {split} clip "
                f"of {len(splits)} in fold {fold}; take another seed, share or method"
            )
    return splits


def _check_listed(origins: Sequence[ClipOrigin], method: str, rule: SplitRule, fold: int) -> None:
    units = {origin.clip: _units(origin, method) for origin in origins}
    unnamed = [clip for clip, names in units.items() if not names]
    if unnamed:
        raise ValueError(f"split by {method} needs the people of every clip; {unnamed[0]} has none")
    known = {unit for names in units.values() for unit in names}
    listed = rule.listed[fold - 1] if rule.listed else ()
    unknown = sorted(
        name for name in listed if not any(_matches(unit, name, method) for unit in known)
    )
    if unknown:
        shown = sorted(known)[:MAX_SHOWN]
        raise ValueError(
            f"fold {fold} lists {', '.join(unknown)}, of whom there is no clip; "
            f"there are {', '.join(shown)}" + (" ..." if len(known) > MAX_SHOWN else "")
        )


def _split(origin: ClipOrigin, method: str, rule: SplitRule, fold: int) -> Split:
    tests = {_tests(method, unit, rule, fold) for unit in _units(origin, method)}
    if tests == {True, False}:
        return "dropped"
    if tests == {True}:
        return "test"
    unit = origin.clip if rule.validation_by == "clip" else origin.recording
    validation = _fraction("validation", unit, rule) < rule.validation_share
    return "validation" if validation else "train"


def _units(origin: ClipOrigin, method: str) -> tuple[str, ...]:
    if method in ("person", "listed_people"):
        return origin.people
    # A published list of pairs may part (a, b) from (b, a).
    named = {
        "clip": origin.clip,
        "recording": origin.recording,
        "listed_recordings": origin.recording,
        "listed": "+".join(origin.people),
    }
    return (named.get(method, origin.pair),)


def _matches(unit: str, listed: str, method: str) -> bool:
    return fnmatchcase(unit, listed) if method == "listed_recordings" else unit == listed


def _tests(method: str, unit: str, rule: SplitRule, fold: int) -> bool:
    if rule.listed:
        return any(_matches(unit, listed, method) for listed in rule.listed[fold - 1])
    return (fold - 1) * rule.test_share <= _fraction(method, unit, rule) < fold * rule.test_share


def _fraction(purpose: str, unit: str, rule: SplitRule) -> float:
    """Hash a text to [0, 1), uniformly and independent of platform and version."""
    text = f"{rule.random_seed}\0{purpose}\0{unit}".encode()
    return int.from_bytes(hashlib.blake2b(text, digest_size=8).digest()) / 2**64
