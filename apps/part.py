"""A file on its way: its bytes in ``NAME.part``, and the note of their version beside them.

The note is JSON in ``NAME.part.json``. Without it the bytes could belong to any version, and are
not built upon.
"""

import json
from dataclasses import asdict, dataclass
from pathlib import Path


@dataclass(frozen=True)
class Version:
    """Which version of a file a server sends: its mark, and its length if the server says."""

    validator: str | None = None
    length: int | None = None


class Part:
    """A file on its way: what is at hand, and of which version.

    Parameters
    ----------
    target : where the whole file will stand; the part stands beside it
    """

    def __init__(self, target: Path) -> None:
        self.file = target.with_name(f"{target.name}.part")
        self._note = target.with_name(f"{target.name}.part.json")

    @property
    def size(self) -> int:
        """Bytes at hand."""
        return self.file.stat().st_size if self.file.exists() else 0

    @property
    def version(self) -> Version:
        """The version that the bytes are of, as far as it is known."""
        try:
            version = Version(**json.loads(self._note.read_text(encoding="utf-8")))
        except (FileNotFoundError, ValueError, TypeError):
            return Version()  # no note, or half of one: the bytes are of an unknown version
        return version if version.length is None or self.size <= version.length else Version()

    @property
    def whole(self) -> bool:
        """Whether nothing is missing."""
        return self.file.exists() and self.version.length == self.size

    def begin(self, version: Version) -> None:
        """Start from nothing: old bytes go before the note of a new version comes."""
        self.file.parent.mkdir(parents=True, exist_ok=True)
        self.file.write_bytes(b"")
        self.note(version)

    def note(self, version: Version) -> None:
        """Write down which version the bytes are of."""
        self._note.write_text(json.dumps(asdict(version)), encoding="utf-8")

    def discard(self) -> None:
        """Forget the bytes and their note."""
        self.file.unlink(missing_ok=True)
        self._note.unlink(missing_ok=True)

    def move_to(self, target: Path) -> None:
        """Give the whole file its name, in one step."""
        self.file.replace(target)
        self._note.unlink(missing_ok=True)
