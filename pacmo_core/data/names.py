"""Names of clips, reactions and variations, which files and tables use as keys.

=================  ==========================================================================
``SEQUENCE#0003``  the fourth clip of a sequence; a sequence that is one clip keeps its name
``CLIP#b``         a clip in one direction: person b reacts to person a, the partner
``CLIP#b#0``       the first sample of person b's reaction
``CLIP~NAME``      a variation: the clip on other bodies
=================  ==========================================================================

``#`` sorts before and ``~`` after every other character of a clip's name, so that what is written
clip by clip is sorted by name.
"""

import difflib
import hashlib
import re
from collections.abc import Iterable
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Literal

Direction = Literal["a", "b"]
DIRECTIONS: tuple[Direction, Direction] = ("a", "b")
MAX_STEM = 150  # bytes of a file's name without suffixes; file systems take 255
MAX_NEAREST = 3  # names in a message
MAX_SAMPLES = 10  # numbers of one digit sort as they count

_SEPARATOR = "#"
_VARIATION_SEPARATOR = "~"
_REACTION = re.compile(r"(?P<clip>.+)#(?P<direction>[ab])#(?P<sample>\d+)", re.DOTALL)


def clip_name(sequence: str, number: int, n_clips: int) -> str:
    """Name clip ``number`` of the ``n_clips`` of a sequence."""
    return sequence if n_clips == 1 else f"{sequence}{_SEPARATOR}{number:04d}"


def directed_name(clip: str, direction: Direction) -> str:
    """Name a clip in the direction in which person ``direction`` reacts."""
    return f"{clip}{_SEPARATOR}{direction}"


def direction_of(directed: str) -> Direction:
    """Return the direction of ``CLIP#b``.

    Raises
    ------
    ValueError
        If the name contains no direction.
    """
    direction = directed.rpartition(_SEPARATOR)[2]
    if direction == "a":
        return "a"
    if direction == "b":
        return "b"
    raise ValueError(
        f"wanted the name of a clip in one direction, CLIP#a or CLIP#b; got {directed}"
    )


def sample_name(directed: str, sample: int) -> str:
    """Name a sample of the reaction in a directed clip."""
    return f"{directed}{_SEPARATOR}{sample}"


@dataclass(frozen=True)
class ReactionName:
    """The name of one generated reaction.

    Parameters
    ----------
    clip : name of the clip
    direction : the person that reacts; the other is the partner
    sample : number of the sample, from 0
    """

    clip: str
    direction: Direction
    sample: int

    def __str__(self) -> str:
        return sample_name(self.directed, self.sample)

    @property
    def directed(self) -> str:
        """The name of the clip in this direction."""
        return directed_name(self.clip, self.direction)

    @classmethod
    def parse(cls, name: str) -> "ReactionName":
        """Parse ``CLIP#b#0``.

        Raises
        ------
        ValueError
            If this is not the name of a reaction.
        """
        match = _REACTION.fullmatch(name)
        if match is None:
            raise ValueError(f"wanted the name of a reaction, CLIP#a#0 or CLIP#b#0; got {name}")
        direction: Direction = "a" if match["direction"] == "a" else "b"
        return cls(match["clip"], direction, int(match["sample"]))


def is_reaction(name: str) -> bool:
    """Return whether this is the name of a reaction."""
    return _REACTION.fullmatch(name) is not None


def variation_name(clip: str, variation: str) -> str:
    """Name a variation of a clip."""
    return f"{clip}{_VARIATION_SEPARATOR}{variation}"


def is_variation(name: str) -> bool:
    """Return whether a name is that of a variation."""
    return _VARIATION_SEPARATOR in name


def split_variation_name(name: str) -> tuple[str, str]:
    """Split ``CLIP~NAME`` into the clip and the name of the variation, empty for a clip."""
    if _VARIATION_SEPARATOR not in name:
        return name, ""
    clip, _, variation = name.rpartition(_VARIATION_SEPARATOR)
    return clip, variation


def file_stem(name: str) -> str:
    """Return the name of a clip as one part of a file's path, which stays in its folder.

    ``/`` and every other character that is unusual in a file's name become ``_``, as does a dot at
    the start; a name that is too long for a file system is cut and ends in its hash.
    """
    stem = re.sub(r"[^\w.#~+ -]", "_", name)
    if len(stem.encode()) > MAX_STEM:
        digest = hashlib.sha256(name.encode(errors="replace")).hexdigest()[:8]
        stem = f"{stem.encode()[:MAX_STEM].decode(errors='ignore')}-{digest}"
    return re.sub(r"^\.", "_", stem)


def sort_clips(clips: Iterable[str]) -> list[str]:
    """Sort clips so that their variations' names ascend: ``one#0001~x`` before ``one~x``."""
    return sorted(clips, key=lambda clip: variation_name(clip, ""))


def nearest_names(name: str, known: Iterable[str]) -> list[str]:
    """Return the names that begin with a name, else those that resemble it; at most three."""
    names = sorted(known)
    longer = [other for other in names if other.startswith(name)]
    return longer[:MAX_NEAREST] or difflib.get_close_matches(name, names, n=MAX_NEAREST)


def nearest_first(name: str, known: Iterable[str]) -> str:
    """List the known names for a message, those that resemble a name first."""
    names = list(known)
    near = nearest_names(name, names)
    return ", ".join([*near, *(other for other in names if other not in near)])


def matches_any(name: str, patterns: Iterable[str]) -> bool:
    """Return whether a name matches one of the patterns of a shell, such as ``01/*``."""
    return any(fnmatchcase(name, pattern) for pattern in patterns)
