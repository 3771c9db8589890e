"""Take the skeletons out of an SBU archive, and nothing else."""

import re
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path

from pacmo_core.project.workspace import CommandError


class ArchiveError(CommandError):
    """An archive that is broken, unsafe, or not what it should be."""


_TAKE = re.compile(r"(?:.*/)?(\d\d/\d\d\d/skeleton_pos\.txt)")
_LARGEST = 8 << 20  # bytes; the longest take at hand has 46 frames in about 40 kB


def skeletons(archive: Path) -> Iterator[tuple[str, bytes]]:
    """Yield ``<action>/<take>/skeleton_pos.txt`` and its bytes, whatever folders lie above.

    The names in the archive are never used as paths. One that would lead out of the folder
    condemns the archive all the same: nobody ships such a file by accident.

    Raises
    ------
    ArchiveError
        If the archive is broken, unsafe, holds a take twice, or none.
    """
    try:
        with zipfile.ZipFile(archive) as opened:
            members = _chosen(archive, opened.infolist())
            for place, member in members.items():
                yield place, opened.read(member)
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError) as error:
        raise ArchiveError(f"{_label(archive)}: not a whole zip archive ({error})") from error


def _chosen(archive: Path, members: list[zipfile.ZipInfo]) -> dict[str, zipfile.ZipInfo]:
    chosen: dict[str, zipfile.ZipInfo] = {}
    for member in members:
        _refuse_escape(archive, member)
        match = _TAKE.fullmatch(member.filename)
        if match is None or member.filename.startswith("__MACOSX/"):
            continue
        if match[1] in chosen:
            raise ArchiveError(f"{_label(archive)}: holds {match[1]} twice")
        if member.file_size > _LARGEST:
            raise ArchiveError(
                f"{_label(archive)}: {member.filename} claims {member.file_size} bytes"
            )
        chosen[match[1]] = member
    if not chosen:
        raise ArchiveError(f"{_label(archive)}: holds no skeleton_pos.txt")
    return chosen


def _refuse_escape(archive: Path, member: zipfile.ZipInfo) -> None:
    name = member.orig_filename.replace("\\", "/")
    is_link = (member.external_attr >> 16) & 0o170000 == 0o120000
    if name.startswith("/") or ".." in name.split("/") or ":" in name or is_link:
        raise ArchiveError(
            f"{_label(archive)}: refused, {member.orig_filename!r} leads out of the folder"
        )


def _label(archive: Path) -> str:
    return archive.name.removesuffix(".part")  # the name that the server knows it by
