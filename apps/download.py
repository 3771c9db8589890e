"""Bring one file from a web server, going on where the last attempt stopped.

The bytes gather in a ``.part`` file. Beside it a small JSON file keeps the server's mark of the
version (ETag or Last-Modified) and the full length, so that a resumed download never joins two
versions of a file (RFC 9110, sections 13.1.5 If-Range and 14 Range).
"""

import json
import re
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import httpx

from apps.failure import CommandError

Report = Callable[[int, int | None], None]  # bytes at hand, bytes in all if the server says

_CONTENT_RANGE = re.compile(r"bytes (\d+)-\d+/(\d+)")


class MissingError(CommandError):
    """The server answers, and does not have the file."""


class _PassingError(Exception):
    """A fault that may pass: worth another attempt."""


@dataclass(frozen=True, kw_only=True)
class Patience:
    """How long to bear with a server.

    Parameters
    ----------
    attempts : failures in a row, none of them bringing the file further, before giving up
    first_wait : seconds before the second attempt; doubled for each further one
    timeout : seconds without a byte that count as a failure
    """

    attempts: int
    first_wait: float
    timeout: float


@dataclass(frozen=True)
class _State:
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
    def state(self) -> _State:
        """The version that the bytes are of, as far as it is known."""
        try:
            state = _State(**json.loads(self._note.read_text(encoding="utf-8")))
        except (FileNotFoundError, ValueError, TypeError):
            return _State()  # no note, or half of one: the bytes are of an unknown version
        return state if state.length is None or self.size <= state.length else _State()

    @property
    def whole(self) -> bool:
        """Whether nothing is missing."""
        return self.file.exists() and self.state.length == self.size

    def begin(self, state: _State) -> None:
        """Start from nothing: old bytes go before the note of a new version comes."""
        self.file.parent.mkdir(parents=True, exist_ok=True)
        self.file.write_bytes(b"")
        self.note(state)

    def note(self, state: _State) -> None:
        """Write down which version the bytes are of."""
        self._note.write_text(json.dumps(asdict(state)), encoding="utf-8")

    def discard(self) -> None:
        """Forget the bytes and their note."""
        self.file.unlink(missing_ok=True)
        self._note.unlink(missing_ok=True)

    def move_to(self, target: Path) -> None:
        """Give the whole file its name, in one step."""
        self.file.replace(target)
        self._note.unlink(missing_ok=True)


def download(
    client: httpx.Client, url: str, part: Part, patience: Patience, report: Report
) -> None:
    """Fill ``part`` with the whole of ``url``.

    Raises
    ------
    MissingError
        If the server does not have the file.
    CommandError
        If the server cannot be reached, keeps failing, or answers with something else. What
        has come so far stays for the next run.
    """
    failures, longest = 0, part.size
    while not part.whole:
        try:
            _attempt(client, url, part, report)
        except (httpx.UnsupportedProtocol, httpx.TooManyRedirects) as error:
            raise CommandError(f"{url}: {error}") from error
        except (httpx.TransportError, _PassingError) as error:
            failures = 1 if part.size > longest else failures + 1
            longest = max(longest, part.size)
            if failures >= patience.attempts:
                raise CommandError(_gave_up(url, error)) from error
            time.sleep(patience.first_wait * 2 ** (failures - 1))


def _attempt(client: httpx.Client, url: str, part: Part, report: Report) -> None:
    headers = {"Accept-Encoding": "identity"}  # lengths and ranges of the file as it is stored
    validator = part.state.validator
    if validator and part.size:
        headers |= {"Range": f"bytes={part.size}-", "If-Range": validator}
    with client.stream("GET", url, headers=headers) as response:
        if "Range" in headers and response.status_code == 416:
            part.discard()
            raise _PassingError("the part is not one of the file's any more")
        _refuse(url, response)
        _place(response, part)
        with part.file.open("ab") as stream:
            for chunk in response.iter_raw():
                stream.write(chunk)
                report(stream.tell(), part.state.length)
    _close(part)


def _place(response: httpx.Response, part: Part) -> None:
    """Go on at the end of the part if the answer does so too, else start from nothing."""
    new = _State(_validator(response), _length(response))
    if response.status_code != 206:
        part.begin(new)
        return
    span = _CONTENT_RANGE.fullmatch(response.headers.get("Content-Range", ""))
    if span is None or int(span[1]) != part.size or not _same(part.state, new, int(span[2])):
        part.discard()
        raise _PassingError(
            "the file on the server has changed, or its answer is not the rest of it"
        )
    part.note(_State(new.validator, int(span[2])))


def _same(old: _State, new: _State, length: int) -> bool:
    return old.validator == new.validator and old.length in (None, length)


def _close(part: Part) -> None:
    state = part.state
    if state.length is None:  # the server sent chunks: their end mark came, so that was all
        part.note(_State(state.validator, part.size))
    elif part.size != state.length:
        raise _PassingError(f"wanted {state.length} bytes, got {part.size}")


def _refuse(url: str, response: httpx.Response) -> None:
    status = response.status_code
    if status in (404, 410):
        raise MissingError(
            f"{url}: not on the server (HTTP {status}); --base-url can name a mirror"
        )
    if status in (408, 429) or status >= 500:
        raise _PassingError(f"HTTP {status} {response.reason_phrase}")
    if status not in (200, 206):
        raise CommandError(f"{url}: wanted the file, got HTTP {status} {response.reason_phrase}")
    if response.headers.get("Content-Type", "").startswith("text/html"):
        raise CommandError(
            f"{url}: wanted the file, got a web page (a log-in page of the network?)"
        )
    if response.headers.get("Content-Encoding", "identity") != "identity":
        raise CommandError(f"{url}: wanted the file as it is, got it packed by the server")


def _validator(response: httpx.Response) -> str | None:
    """Return the mark that If-Range accepts: a strong ETag, else the date (RFC 9110, 13.1.5)."""
    etag: str | None = response.headers.get("ETag")
    if etag and not etag.startswith("W/"):
        return etag
    date: str | None = response.headers.get("Last-Modified")
    return date


def _length(response: httpx.Response) -> int | None:
    stated = response.headers.get("Content-Length")
    if stated is None and response.headers.get("Transfer-Encoding") != "chunked":
        raise CommandError(
            f"{response.url}: the server states no length, so a cut would go unnoticed"
        )
    return None if stated is None else int(stated)


def _gave_up(url: str, error: Exception) -> str:
    if isinstance(error, httpx.ConnectError | httpx.ConnectTimeout | httpx.ProxyError):
        return (
            f"cannot reach {httpx.URL(url).host} ({error}); is this machine online, does it need "
            "HTTPS_PROXY? What has come so far is kept: run the same command again, or name a "
            "mirror by --base-url"
        )
    reason = str(error) or type(error).__name__
    return f"{url}: gave up ({reason}); what has come so far is kept: run the same command again"
