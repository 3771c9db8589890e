"""Resumable downloads, their checksums, and the extraction of skeletons from archives.

The bytes of an unfinished download are in ``NAME.part``, the version of the file on the server in
``NAME.part.json``. Without a known version a download starts again from the beginning.
"""

import hashlib
import json
import re
import struct
import time
import zipfile
import zlib
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from importlib import resources
from pathlib import Path

import httpx

from pacmo_core.project.workspace import CommandError


@dataclass(frozen=True)
class FileVersion:
    """The version of a file on a server: ETag or date, and the length if the server states it."""

    validator: str | None = None
    length: int | None = None


_TEXT, _NUMBER = (str, type(None)), (int, type(None))


class PartialFile:
    """An unfinished download.

    Parameters
    ----------
    target : path of the complete file; the partial file is in the same folder
    """

    def __init__(self, target: Path) -> None:
        self.file = target.with_name(f"{target.name}.part")
        self._note = target.with_name(f"{target.name}.part.json")

    @property
    def size(self) -> int:
        """Number of bytes downloaded so far."""
        return self.file.stat().st_size if self.file.exists() else 0

    @property
    def version(self) -> FileVersion:
        """The version that the bytes belong to; empty if it is unknown."""
        try:
            version = FileVersion(**json.loads(self._note.read_text(encoding="utf-8")))
        except (FileNotFoundError, ValueError, TypeError, RecursionError):
            return FileVersion()  # the version file is missing or damaged
        if type(version.validator) not in _TEXT or type(version.length) not in _NUMBER:
            return FileVersion()
        return version if version.length is None or self.size <= version.length else FileVersion()

    @property
    def whole(self) -> bool:
        """Whether the download is complete."""
        return self.file.exists() and self.version.length == self.size

    def begin(self, version: FileVersion) -> None:
        """Start again: remove the bytes, then write the new version."""
        self.file.parent.mkdir(parents=True, exist_ok=True)
        self.file.write_bytes(b"")
        self.note(version)

    def note(self, version: FileVersion) -> None:
        """Write the version that the bytes belong to."""
        self._note.write_text(json.dumps(asdict(version)), encoding="utf-8")

    def discard(self) -> None:
        """Remove the bytes and the version."""
        self.file.unlink(missing_ok=True)
        self._note.unlink(missing_ok=True)

    def move_to(self, target: Path) -> None:
        """Rename the complete file, atomically."""
        self.file.replace(target)
        self._note.unlink(missing_ok=True)


FILE_NAME = "SHA256SUMS"
_LINE = re.compile(r"([0-9a-f]{64}) [ *](.+)")


def shipped_checksums() -> dict[str, str]:
    """Read the SHA-256 checksums that come with this package, by path."""
    text = (
        resources.files("pacmo_core.commands")
        .joinpath("known_checksums.json")
        .read_text(encoding="utf-8")
    )
    sums: dict[str, str] = json.loads(text)["sha256"]
    return sums


def sha256_of(file: Path) -> str:
    """Compute the SHA-256 of a file in chunks."""
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


class Checksums:
    """The expected checksums of the files in a folder.

    Parameters
    ----------
    root : folder with ``SHA256SUMS``, in the format of ``sha256sum --check``
    known : checksums that come with this package, by path relative to ``root``

    Raises
    ------
    CommandError
        If ``SHA256SUMS`` has a line that is not a checksum and a path.
    """

    def __init__(self, root: Path, known: dict[str, str]) -> None:
        self.root, self.known = root, known
        self.recorded = _read(root / FILE_NAME)

    def wanted(self, place: str) -> str | None:
        """Return the expected checksum of a file; None before its first download.

        A recorded checksum takes precedence: the two differ only after ``--accept-changed``.
        """
        return self.recorded.get(place) or self.known.get(place)

    def places(self, folder: str) -> list[str]:
        """List the known and recorded files in ``folder``."""
        return sorted(p for p in {*self.known, *self.recorded} if p.startswith(f"{folder}/"))

    def verified(self, place: str) -> bool:
        """Return whether the file exists and has its expected checksum."""
        file = self.root / place
        return file.is_file() and sha256_of(file) == self.wanted(place)

    def record(self, place: str, sha256: str) -> None:
        """Record the checksum of a file, against which later runs verify it."""
        self.recorded[place] = sha256
        lines = [f"{self.recorded[name]}  {name}\n" for name in sorted(self.recorded)]
        temporary = self.root / f"{FILE_NAME}.new"
        temporary.write_text("".join(lines), encoding="utf-8", newline="\n")
        temporary.replace(self.root / FILE_NAME)


def _read(file: Path) -> dict[str, str]:
    if not file.exists():
        return {}
    sums = {}
    text = file.read_text(encoding="utf-8", errors="replace")
    for number, line in enumerate(text.splitlines(), start=1):
        match = _LINE.fullmatch(line)
        if match is None:
            raise CommandError(f"{file}:{number}: wanted '<sha256>  <file>', got {line!r}")
        sums[match[2]] = match[1]
    return sums


class ArchiveError(CommandError):
    """An archive that is damaged, unsafe, or has unexpected contents."""


_TAKE = re.compile(r"(?:.*/)?(\d\d/\d\d\d/skeleton_pos\.txt)", re.ASCII)
_MAX_BYTES = 8 << 20  # bytes; a take of 46 frames has about 40 kB
_MAX_MEMBERS = 200_000  # of an archive: those of SBU have some thousands of pictures
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)  # the others inflate without a limit
_ENCRYPTED = 0x1
# Of zipfile on damaged archives: names that are no UTF-8, dates, offsets and sizes that are none.
_BROKEN = (
    *(zipfile.BadZipFile, zlib.error, struct.error, EOFError),
    *(NotImplementedError, ValueError, OverflowError, RuntimeError, OSError),
)


def extract_skeletons(archive: Path) -> Iterator[tuple[str, bytes]]:
    """Yield ``<action>/<take>/skeleton_pos.txt`` and its bytes, without leading folders.

    The names in the archive are never used as paths. An archive with a name that leads out of the
    folder is rejected as a whole: such a name is not there by accident.

    Raises
    ------
    ArchiveError
        If the archive is damaged, unsafe, holds a take twice, or holds none.
    """
    try:
        with zipfile.ZipFile(archive) as opened:
            members = _selected_members(archive, opened.infolist())
            for path, member in members.items():
                yield path, opened.read(member)
    except _BROKEN as error:
        raise ArchiveError(f"{_label(archive)}: not a complete zip archive ({error})") from error


def _selected_members(archive: Path, members: list[zipfile.ZipInfo]) -> dict[str, zipfile.ZipInfo]:
    selected: dict[str, zipfile.ZipInfo] = {}
    if len(members) > _MAX_MEMBERS:
        raise ArchiveError(f"{_label(archive)}: holds more than {_MAX_MEMBERS} files")
    for member in members:
        _refuse_escape(archive, member)
        match = _TAKE.fullmatch(member.filename)
        if match is None or member.filename.startswith("__MACOSX/"):
            continue
        if match[1] in selected:
            raise ArchiveError(f"{_label(archive)}: holds {match[1]} twice")
        _check_member(archive, member)
        selected[match[1]] = member
    if not selected:
        raise ArchiveError(f"{_label(archive)}: holds no skeleton_pos.txt")
    return selected


def _check_member(archive: Path, member: zipfile.ZipInfo) -> None:
    """Refuse a take that is encrypted, packed in an unusual way, or larger than a take."""
    what = f"{_label(archive)}: {member.filename}"
    if member.flag_bits & _ENCRYPTED:
        raise ArchiveError(f"{what} is encrypted")
    if member.compress_type not in _METHODS:
        raise ArchiveError(f"{what} is packed by method {member.compress_type}")
    if member.file_size > _MAX_BYTES:
        raise ArchiveError(f"{what} claims {member.file_size} bytes")


def _refuse_escape(archive: Path, member: zipfile.ZipInfo) -> None:
    name = member.orig_filename.replace("\\", "/")
    is_link = (member.external_attr >> 16) & 0o170000 == 0o120000
    if name.startswith("/") or ".." in name.split("/") or ":" in name or is_link:
        raise ArchiveError(
            f"{_label(archive)}: refused, {member.orig_filename!r} leads out of the folder"
        )


def _label(archive: Path) -> str:
    return archive.name.removesuffix(".part")  # the name on the server


Report = Callable[[int, int | None], None]  # bytes so far, total bytes if known

_CONTENT_RANGE = re.compile(r"bytes (\d{1,18})-\d+/(\d{1,18})", re.ASCII)
_DIGITS = re.compile(r"\d{1,18}", re.ASCII)


class MissingError(CommandError):
    """The server responds and does not have the file."""


class _TransientError(Exception):
    """A fault that another attempt may not meet."""


@dataclass(frozen=True, kw_only=True)
class RetryPolicy:
    """How often and how long to retry.

    Parameters
    ----------
    attempts : consecutive failures without a further byte before giving up
    first_wait : seconds before the second attempt; doubled for each further one
    timeout : seconds without a byte that count as a failure
    """

    attempts: int
    first_wait: float
    timeout: float


def download(
    client: httpx.Client, url: str, part: PartialFile, retry: RetryPolicy, report: Report
) -> None:
    """Download ``url`` into ``part``, from where it was interrupted.

    Raises
    ------
    MissingError
        If the server does not have the file.
    CommandError
        If the server cannot be reached, keeps failing, or responds with something else. The
        partial file is kept for the next run.
    """
    failures, longest = 0, part.size
    while not part.whole:
        try:
            _attempt(client, url, part, report)
        except (httpx.UnsupportedProtocol, httpx.TooManyRedirects) as error:
            raise CommandError(f"{url}: {error}") from error
        except (httpx.TransportError, _TransientError) as error:
            failures = 1 if part.size > longest else failures + 1
            longest = max(longest, part.size)
            if failures >= retry.attempts:
                raise CommandError(_failure_message(url, error)) from error
            time.sleep(retry.first_wait * 2 ** (failures - 1))


def _attempt(client: httpx.Client, url: str, part: PartialFile, report: Report) -> None:
    headers = {"Accept-Encoding": "identity"}  # lengths and ranges of the file as it is stored
    validator = part.version.validator
    if validator and part.size:
        headers |= {"Range": f"bytes={part.size}-", "If-Range": validator}
    with client.stream("GET", url, headers=headers) as response:
        if "Range" in headers and response.status_code == 416:
            part.discard()
            raise _TransientError("the partial file does not match the file on the server")
        _refuse(url, response)
        _check_offset(response, part)
        with part.file.open("ab") as stream:
            for chunk in response.iter_raw():
                stream.write(chunk)
                report(stream.tell(), part.version.length)
    _close(part)


def _check_offset(response: httpx.Response, part: PartialFile) -> None:
    """Append if the response continues the partial file; otherwise start again."""
    new = FileVersion(_validator(response), _length(response))
    if response.status_code != 206:
        part.begin(new)
        return
    span = _CONTENT_RANGE.fullmatch(response.headers.get("Content-Range", ""))
    if (
        span is None
        or int(span[1]) != part.size
        or not _is_same_version(part.version, new, int(span[2]))
    ):
        part.discard()
        raise _TransientError(
            "the file on the server has changed, or the response does not continue the partial file"
        )
    part.note(FileVersion(new.validator, int(span[2])))


def _is_same_version(old: FileVersion, new: FileVersion, length: int) -> bool:
    return old.validator == new.validator and old.length in (None, length)


def _close(part: PartialFile) -> None:
    version = part.version
    if version.length is None:  # chunked transfer: its end marker has arrived
        part.note(FileVersion(version.validator, part.size))
    elif part.size != version.length:
        raise _TransientError(f"wanted {version.length} bytes, got {part.size}")


def _refuse(url: str, response: httpx.Response) -> None:
    status = response.status_code
    if status in (404, 410):
        raise MissingError(
            f"{url}: not on the server (HTTP {status}); --base-url can name a mirror"
        )
    if status in (408, 429) or status >= 500:
        raise _TransientError(f"HTTP {status} {response.reason_phrase}")
    if status not in (200, 206):
        raise CommandError(f"{url}: wanted the file, got HTTP {status} {response.reason_phrase}")
    if response.headers.get("Content-Type", "").startswith("text/html"):
        raise CommandError(
            f"{url}: wanted the file, got a web page (a log-in page of the network?)"
        )
    if response.headers.get("Content-Encoding", "identity") != "identity":
        raise CommandError(f"{url}: wanted the file as it is, got it compressed by the server")


def _validator(response: httpx.Response) -> str | None:
    """Return the validator for If-Range: a strong ETag, else the date (RFC 9110, 13.1.5)."""
    etag: str | None = response.headers.get("ETag")
    if etag and not etag.startswith("W/"):
        return etag
    date: str | None = response.headers.get("Last-Modified")
    return date


def _length(response: httpx.Response) -> int | None:
    stated = response.headers.get("Content-Length")
    if stated is None and response.headers.get("Transfer-Encoding") != "chunked":
        raise CommandError(
            f"{response.url}: no length stated, so an incomplete file could not be detected"
        )
    if stated is not None and not _DIGITS.fullmatch(stated):
        raise CommandError(f"{response.url}: wanted a length, got {stated!r:.40}")
    return None if stated is None else int(stated)


def _failure_message(url: str, error: Exception) -> str:
    if isinstance(error, httpx.ConnectError | httpx.ConnectTimeout | httpx.ProxyError):
        return (
            f"cannot reach {httpx.URL(url).host} ({error}); is this machine online, does it need "
            "HTTPS_PROXY? The partial file is kept: run the same command again, or name a mirror "
            "with --base-url"
        )
    reason = str(error) or type(error).__name__
    return f"{url}: gave up ({reason}); the partial file is kept: run the same command again"
