"""What every raw format offers: find the sequences under a folder, read one of them."""

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from pacmo_core.data.interaction import Interaction


class FormatError(ValueError):
    """A raw file that cannot be read as what it claims to be.

    Parameters
    ----------
    file : the file at fault
    reason : what was wanted and what was got
    line : 1-based, where the format has lines
    """

    def __init__(self, file: Path, reason: str, line: int | None = None) -> None:
        self.file, self.reason, self.line = file, reason, line
        super().__init__(f"{file}:{line}: {reason}" if line else f"{file}: {reason}")

    def __reduce__(self) -> tuple[type["FormatError"], tuple[Path, str, int | None]]:
        """Cross process boundaries whole: the default would hand the message on as the file."""
        return FormatError, (self.file, self.reason, self.line)


@dataclass(frozen=True)
class RawSequence:
    """One recording as shipped, found but not yet read.

    Parameters
    ----------
    name : unique in its set and stable; letters, digits, ``_ - .`` and ``/``
    files : the files that hold it, person a's first where each person has one
    action : the data set's label, empty where unknown
    subjects : who person a and person b are, empty where unknown
    recording : what a split by recording keeps together
    """

    name: str
    files: tuple[Path, ...]
    action: str = ""
    subjects: tuple[str, str] = ("", "")
    recording: str = ""


@dataclass(frozen=True)
class Reading:
    """What came of reading one sequence.

    Parameters
    ----------
    interaction : both people
    filled_frames : poses of one person that the file lacks and the reader interpolated
    """

    interaction: Interaction
    filled_frames: int = 0


class Format(Protocol):
    """A raw format with its settings fixed."""

    def find(self, root: Path) -> list[RawSequence]:
        """List every sequence under ``root`` by name, without reading motion.

        A file that has the format's ending and no place in a sequence (one person's without the
        other's, say) is listed too: ``read`` refuses it with the reason.
        """
        ...

    def read(self, sequence: RawSequence) -> Reading:
        """Read one sequence into metres, y up, right-handed, seconds.

        Raises
        ------
        FormatError
            If a file is not what it should be: with the file, the line and the reason.
        """
        ...
