"""Cut long recordings into clips, and put every clip on a side: train, validation or test.

Sides come from a hash of what must stay together, never from a shuffled list: adding a capture
moves no other clip. The price is that shares are met on average, not exactly.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

METHODS = ("auto", "clip", "recording", "pair", "person", "listed")


@dataclass(frozen=True)
class Origin:
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
class SideRule:
    """How clips are put on sides.

    Parameters
    ----------
    method : ``clip`` (the papers' random split; it leaks people), ``recording``, ``pair``,
        ``person`` (nobody stands on both sides), ``listed`` (pairs named in ``test_pairs``), or
        ``auto``: ``person`` where at least ``min_people`` people are known, else ``recording``
    test_share, validation_share : expected shares of what is hashed
    min_people : for ``auto``
    test_pairs : for ``listed``, such as a published fold: ``s01+s02``
    random_seed : another seed, another split
    """

    method: str
    test_share: float
    validation_share: float
    min_people: int
    test_pairs: tuple[str, ...]
    random_seed: int

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise ValueError(f"method must be one of {', '.join(METHODS)}; got {self.method}")
        if not 0 < self.test_share < 1 or not 0 <= self.validation_share < 1:
            raise ValueError(
                f"shares must lie between 0 and 1; got test {self.test_share}, "
                f"validation {self.validation_share}"
            )


Side = Literal["train", "validation", "test", "dropped"]


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


def resolve_method(origins: Sequence[Origin], rule: SideRule) -> str:
    """Say which method ``auto`` means for these clips."""
    if rule.method != "auto":
        return rule.method
    people = {person for origin in origins for person in origin.people}
    everywhere = all(origin.people for origin in origins)
    return "person" if everywhere and len(people) >= rule.min_people else "recording"


def assign_sides(origins: Sequence[Origin], rule: SideRule) -> dict[str, Side]:
    """Put every clip on a side.

    Validation clips are taken from training by recording, whatever the method: they choose
    checkpoints and are no claim about new people. Split by person, a clip whose two people
    stand on different sides is ``dropped``.

    Returns
    -------
    side of each clip by name

    Raises
    ------
    ValueError
        If nothing is left to train on or to test on.
    """
    method = resolve_method(origins, rule)
    sides = {origin.clip: _side(origin, method, rule) for origin in origins}
    for wanted in ("train", "test"):
        if wanted not in sides.values():
            raise ValueError(
                f"split by {method} with random_seed {rule.random_seed} leaves no {wanted} clip "
                f"of {len(sides)}; take another seed, share or method"
            )
    return sides


def _side(origin: Origin, method: str, rule: SideRule) -> Side:
    tests = {_tests(method, unit, rule) for unit in _units(origin, method)}
    if tests == {True, False}:
        return "dropped"
    if tests == {True}:
        return "test"
    validation = _fraction("validation", origin.recording, rule) < rule.validation_share
    return "validation" if validation else "train"


def _units(origin: Origin, method: str) -> tuple[str, ...]:
    if method == "person":
        return origin.people
    return ({"clip": origin.clip, "recording": origin.recording}.get(method, origin.pair),)


def _tests(method: str, unit: str, rule: SideRule) -> bool:
    if method == "listed":
        return unit in rule.test_pairs
    return _fraction(method, unit, rule) < rule.test_share


def _fraction(purpose: str, unit: str, rule: SideRule) -> float:
    """Hash to [0, 1): evenly, the same everywhere and for ever."""
    text = f"{rule.random_seed}\0{purpose}\0{unit}".encode()
    return int.from_bytes(hashlib.blake2b(text, digest_size=8).digest()) / 2**64
