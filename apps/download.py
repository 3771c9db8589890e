"""Bring one file from a web server, going on where the last attempt stopped.

A resumed download never joins two versions of a file: it asks for the rest only of the version
whose mark (ETag or Last-Modified) it holds (RFC 9110, sections 13.1.5 If-Range and 14 Range).
"""

import re
import time
from collections.abc import Callable
from dataclasses import dataclass

import httpx

from apps.part import Part, Version
from pacmo_core.project.workspace import CommandError

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
    validator = part.version.validator
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
                report(stream.tell(), part.version.length)
    _close(part)


def _place(response: httpx.Response, part: Part) -> None:
    """Go on at the end of the part if the answer does so too, else start from nothing."""
    new = Version(_validator(response), _length(response))
    if response.status_code != 206:
        part.begin(new)
        return
    span = _CONTENT_RANGE.fullmatch(response.headers.get("Content-Range", ""))
    if span is None or int(span[1]) != part.size or not _same(part.version, new, int(span[2])):
        part.discard()
        raise _PassingError(
            "the file on the server has changed, or its answer is not the rest of it"
        )
    part.note(Version(new.validator, int(span[2])))


def _same(old: Version, new: Version, length: int) -> bool:
    return old.validator == new.validator and old.length in (None, length)


def _close(part: Part) -> None:
    version = part.version
    if version.length is None:  # the server sent chunks: their end mark came, so that was all
        part.note(Version(version.validator, part.size))
    elif part.size != version.length:
        raise _PassingError(f"wanted {version.length} bytes, got {part.size}")


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
