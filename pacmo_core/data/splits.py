"""Cut long recordings into clips, and put every clip on a side: train, validation or test.

Sides come from a hash of what must stay together, never from a shuffled list: adding a capture
moves no other clip. The price is that shares are met on average, not exactly.

Fold k of a hashed split tests the k-th slice of ``[0, 1)``, each of width ``test_share``: what one
fold tests, no other does.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

METHODS = ("auto", "clip", "recording", "pair", "person", "listed", "listed_people")


@dataclass(frozen=True)
class ClipOrigin:
    """What a clip must not share with a clip on the other side.

    Parameters
    ----------
    clip, recording : names
    people : who stands in it, as far as the data set says
    """

    clip: str
    recording: str
    people: tuple[str, ...]

    @property
    def pair(self) -> str:
        """The people as one name, whatever their order."""
        return "+".join(sorted(self.people))


@dataclass(frozen=True)
class SplitRule:
    """How clips are put on sides.

    Parameters
    ----------
    method : ``clip`` (the papers' random split; it leaks people), ``recording``, ``pair``,
        ``person`` (nobody stands on both sides), ``listed`` (pairs named in ``test_pairs``),
        ``listed_people`` (people named in ``test_people``; nobody stands on both sides), or
        ``auto``: ``person`` where at least ``min_people`` people are known, else ``recording``
    test_share, validation_share : expected shares of what is hashed
    validation_by : ``recording``, or ``clip`` where no recording can be spared from training
    min_people : for ``auto``
    test_pairs : for ``listed``, the pairs that each fold tests, such as the published folds:
        ``s01+s02``, the people in the order of their data set
    test_people : for ``listed_people``, the people that each fold tests
    random_seed : another seed, another split
    """

    method: str
    test_share: float
    validation_share: float
    validation_by: str
    min_people: int
    test_pairs: tuple[tuple[str, ...], ...]
    test_people: tuple[tuple[str, ...], ...]
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
        """What each fold tests, for a method that says so by name."""
        return {"listed": self.test_pairs, "listed_people": self.test_people}.get(self.method, ())

    def check_fold(self, fold: int) -> None:
        """Refuse a fold that the rule does not have.

        Raises
        ------
        ValueError
            If the fold is not listed, or does not fit into what is hashed.
        """
        listed = self.method.startswith("listed")
        n_folds = len(self.listed) if listed else int(1 / self.test_share + ROUNDING)
        if not 1 <= fold <= n_folds:
            why = "are listed" if listed else f"of test_share {self.test_share} fit into 1"
            raise ValueError(f"fold must be 1 to {n_folds}, as many as {why}; got {fold}")


Split = Literal["train", "validation", "test", "dropped"]
ROUNDING = 1e-9  # five folds of a share of 0.2 fit, whatever 5 x 0.2 rounds to


def window_edges(n_frames: int, fps: float, seconds: float) -> list[tuple[int, int]]:
    """Cut a recording into equal windows, without overlap, as near to ``seconds`` as they go.

    A recording of up to one and a half windows stays whole.

    Returns
    -------
    (start, stop) frames of each window, stop exclusive
    """
    n_windows = max(1, round(n_frames / fps / seconds))
    edges = np.linspace(0, n_frames, n_windows + 1).round().astype(int).tolist()
    return list(pairwise(edges))


def resolve_method(origins: Sequence[ClipOrigin], rule: SplitRule) -> str:
    """Say which method ``auto`` means for these clips."""
    if rule.method != "auto":
        return rule.method
    people = {person for origin in origins for person in origin.people}
    everywhere = all(origin.people for origin in origins)
    return "person" if everywhere and len(people) >= rule.min_people else "recording"


def assign_splits(origins: Sequence[ClipOrigin], rule: SplitRule, fold: int) -> dict[str, Split]:
    """Put every clip on a side.

    Validation clips are taken from training by recording or by clip, whatever the method: they
    choose checkpoints and are no claim about new people. Split by person, a clip whose two
    people stand on different sides is ``dropped``.

    Returns
    -------
    side of each clip by name, in the fold of that number, counted from 1

    Raises
    ------
    ValueError
        If the rule has no such fold, it names a pair or a person that no clip has, it is by
        person and a clip names none, or nothing is left to train on or to test on.
    """
    rule.check_fold(fold)
    method = resolve_method(origins, rule)
    _check_units(origins, method, rule, fold)
    sides = {origin.clip: _side(origin, method, rule, fold) for origin in origins}
    for wanted in ("train", "test"):
        if wanted not in sides.values():
            raise ValueError(
                f"split by {method} with random_seed {rule.random_seed} leaves no {wanted} clip "
                f"of {len(sides)} in fold {fold}; take another seed, share or method"
            )
    return sides


def _check_units(origins: Sequence[ClipOrigin], method: str, rule: SplitRule, fold: int) -> None:
    units = {origin.clip: _units(origin, method) for origin in origins}
    nameless = [clip for clip, names in units.items() if not names]
    if nameless:
        raise ValueError(
            f"split by {method} wants the people of every clip; {nameless[0]} has none"
        )
    known = {unit for names in units.values() for unit in names}
    unknown = set(rule.listed[fold - 1]) - known if rule.listed else set()
    if unknown:
        raise ValueError(
            f"fold {fold} lists {', '.join(sorted(unknown))}, of whom there is no clip; "
            f"there are {', '.join(sorted(known))}"
        )


def _side(origin: ClipOrigin, method: str, rule: SplitRule, fold: int) -> Split:
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
    named = {"clip": origin.clip, "recording": origin.recording, "listed": "+".join(origin.people)}
    return (named.get(method, origin.pair),)


def _tests(method: str, unit: str, rule: SplitRule, fold: int) -> bool:
    if rule.listed:
        return unit in rule.listed[fold - 1]
    return (fold - 1) * rule.test_share <= _fraction(method, unit, rule) < fold * rule.test_share


def _fraction(purpose: str, unit: str, rule: SplitRule) -> float:
    """Hash to [0, 1): evenly, the same everywhere and for ever."""
    text = f"{rule.random_seed}\0{purpose}\0{unit}".encode()
    return int.from_bytes(hashlib.blake2b(text, digest_size=8).digest()) / 2**64
