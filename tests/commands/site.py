"""A web server on the loopback address that keeps count, and misbehaves when told to."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any


@dataclass
class Site:
    """What the server holds, how it behaves, and what it did.

    Parameters
    ----------
    files : by path, with the leading slash
    ranges : whether it can send the rest of a file
    honest : whether it looks at If-Range before it sends the rest
    marks : headers that mark the version of every file
    faults : statuses to answer first, one a request
    cuts : bytes after which to hang up, one a request, None for never
    claim : a Content-Length to state whatever is sent
    shift : bytes by which the rest that it sends begins too late
    at_most : bytes of the rest that it sends at once, as RFC 9110 (14.2) allows
    """

    files: dict[str, bytes] = field(default_factory=dict)
    ranges: bool = True
    honest: bool = True
    marks: dict[str, str] = field(default_factory=lambda: {"ETag": '"one"'})
    faults: list[int] = field(default_factory=list)
    cuts: list[int | None] = field(default_factory=list)
    claim: int | None = None
    shift: int = 0
    at_most: int | None = None
    headers: dict[str, str] = field(default_factory=dict)
    asked: list[tuple[str, str | None]] = field(default_factory=list)
    sent: int = 0
    url: str = ""


@contextmanager
def serving(site: Site) -> Iterator[Site]:
    """Serve ``site`` on a free port until the end of the block."""

    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def log_message(self, *args: Any) -> None:
            """Keep quiet."""

        def handle(self) -> None:
            with suppress(ConnectionError):  # a client that was killed
                super().handle()

        def do_GET(self) -> None:
            _answer(self, site)

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        site.url = f"http://127.0.0.1:{server.server_address[1]}"
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        try:
            yield site
        finally:
            server.shutdown()
            thread.join()


def _answer(handler: BaseHTTPRequestHandler, site: Site) -> None:
    wanted = handler.headers.get("Range")
    site.asked.append((handler.path, wanted))
    status = site.faults.pop(0) if site.faults else 200
    content = site.files.get(handler.path)
    if status == 200 and content is None:
        status = 404
    if status != 200:
        handler.send_response(status)
        handler.send_header("Content-Length", "0")
        handler.end_headers()
        return
    assert content is not None
    start = _start(handler, site, wanted)
    stop = len(content) if not start or site.at_most is None else start + site.at_most
    part = content[start:stop]
    handler.send_response(206 if start else 200)
    if start:
        last = start + len(part) - 1
        handler.send_header("Content-Range", f"bytes {start}-{last}/{len(content)}")
    length = site.claim if site.claim is not None else len(part)
    for name, value in {"Content-Length": str(length), **site.marks, **site.headers}.items():
        if value:
            handler.send_header(name, value)
    handler.end_headers()
    cut = site.cuts.pop(0) if site.cuts else None
    body = part[:cut]
    site.sent += len(body)
    handler.close_connection = cut is not None or site.claim is not None
    handler.wfile.write(body)


def _start(handler: BaseHTTPRequestHandler, site: Site, wanted: str | None) -> int:
    if wanted is None or not site.ranges:
        return 0
    if site.honest and handler.headers.get("If-Range") not in site.marks.values():
        return 0
    return int(wanted.removeprefix("bytes=").removesuffix("-")) + site.shift
