"""What every fetched file should hold: sums shipped with the project, then sums once recorded."""

import hashlib
import json
import re
from importlib import resources
from pathlib import Path

from pacmo_core.project.workspace import CommandError

FILE_NAME = "SHA256SUMS"
_LINE = re.compile(r"([0-9a-f]{64}) [ *](.+)")


def shipped() -> dict[str, str]:
    """Read the SHA-256 of every file that was at hand when this was written, by its place."""
    text = resources.files("apps").joinpath("known_sums.json").read_text(encoding="utf-8")
    sums: dict[str, str] = json.loads(text)["sha256"]
    return sums


def digest(file: Path) -> str:
    """Compute a file's SHA-256 without holding the file in memory."""
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


class Sums:
    """The sums that files under one folder should have.

    Parameters
    ----------
    root : holds ``SHA256SUMS``, in the format that ``sha256sum --check`` reads
    known : sums that are known beforehand, by place under ``root``

    Raises
    ------
    CommandError
        If ``SHA256SUMS`` has a line that is not a sum and a place.
    """

    def __init__(self, root: Path, known: dict[str, str]) -> None:
        self.root, self.known = root, known
        self.recorded = _read(root / FILE_NAME)

    def wanted(self, place: str) -> str | None:
        """Return the sum that the file should have; None before its first download.

        A record goes before a shipped sum: the two differ only if a person chose the server's.
        """
        return self.recorded.get(place) or self.known.get(place)

    def places(self, folder: str) -> list[str]:
        """List every file that is known or recorded under ``folder``."""
        return sorted(p for p in {*self.known, *self.recorded} if p.startswith(f"{folder}/"))

    def verified(self, place: str) -> bool:
        """Say whether the file is there and holds what it should."""
        file = self.root / place
        return file.is_file() and digest(file) == self.wanted(place)

    def record(self, place: str, sha256: str) -> None:
        """Write a file's sum down, so that later runs hold the file against it."""
        self.recorded[place] = sha256
        lines = [f"{self.recorded[name]}  {name}\n" for name in sorted(self.recorded)]
        temporary = self.root / f"{FILE_NAME}.new"
        temporary.write_text("".join(lines), encoding="utf-8", newline="\n")
        temporary.replace(self.root / FILE_NAME)


def _read(file: Path) -> dict[str, str]:
    if not file.exists():
        return {}
    sums = {}
    for number, line in enumerate(file.read_text(encoding="utf-8").splitlines(), start=1):
        match = _LINE.fullmatch(line)
        if match is None:
            raise CommandError(f"{file}:{number}: wanted '<sha256>  <file>', got {line!r}")
        sums[match[2]] = match[1]
    return sums
