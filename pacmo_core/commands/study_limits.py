"""What one client may ask of the server of a study: sizes, rates, participants, connections.

Addresses are held in memory only, and only as long as the server runs.
"""

import resource
import threading
import time
from asyncio import Transport
from collections import Counter
from dataclasses import dataclass, field
from ipaddress import IPv6Address, ip_address, ip_network

from fastapi import Request, Response
from fastapi.responses import JSONResponse
from starlette.datastructures import MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol

MAX_BODY = 1000  # bytes
MAX_ADDRESSES = 50_000
MAX_CONNECTIONS = 500
# asyncio accepts as many new connections as may wait before it reads from any that is open: with
# uvicorn's 2048 a client that keeps connecting holds up each of the other clients' steps by
# thousands of connections. One that finds the queue full is tried again by its system.
ACCEPTS_AT_ONCE = 64
_OTHER_FILES = 100  # open files of the server besides its connections
_IPV6_SUBSCRIBER = 64  # bits of an address that a provider assigns to one subscriber


def network_of(address: str) -> str:
    """Return what counts as one client: an IPv4 address, or the subscriber's part of an IPv6 one.

    A text that is no address, as of a socket in the file system, is returned as it is.
    """
    try:
        parsed = ip_address(address)
    except ValueError:
        return address
    if not isinstance(parsed, IPv6Address):
        return address
    if parsed.ipv4_mapped:
        return str(parsed.ipv4_mapped)
    return str(ip_network((parsed, _IPV6_SUBSCRIBER), strict=False))


def client_of(request: Request) -> str:
    """Return ``network_of`` the sender of a request."""
    return network_of(request.client.host) if request.client else ""


@dataclass
class RateLimiter:
    """A token bucket for each client.

    Those with the oldest requests are removed.

    Parameters
    ----------
    rate : requests per second
    burst : requests at once
    """

    rate: float
    burst: float
    _seen: dict[str, tuple[float, float]] = field(default_factory=dict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def allows(self, client: str, now: float) -> bool:
        """Count a request; return whether it is within the limit."""
        with self._lock:
            remaining, then = self._seen.pop(client, (self.burst, now))
            remaining = min(self.burst, remaining + (now - then) * self.rate)
            self._seen[client] = (remaining - 1 if remaining >= 1 else remaining, now)
            if len(self._seen) > MAX_ADDRESSES:
                del self._seen[next(iter(self._seen))]
            return remaining >= 1


@dataclass
class ParticipantLimiter:
    """The number of participants that each client may begin while the server runs."""

    per_client: int
    _begun: Counter[str] = field(default_factory=Counter)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def allows(self, client: str) -> bool:
        """Count a participant; return whether the client may have one more."""
        with self._lock:
            if self._begun[client] >= self.per_client or len(self._begun) > MAX_ADDRESSES:
                return False
            self._begun[client] += 1
            return True


@dataclass(frozen=True)
class Guard:
    """An application behind limits, with headers on every response.

    Requests that are too large or too frequent are refused before anything of their body is read.

    Parameters
    ----------
    app : the application behind it
    limiter : of the rate of requests
    headers : of every response
    """

    app: ASGIApp
    limiter: RateLimiter
    headers: dict[str, str]

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, as ASGI defines."""

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).update(self.headers)
            await send(message)

        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        app = self._refusal(Request(scope)) or self.app
        await app(scope, receive, send_with_headers)

    def _refusal(self, request: Request) -> Response | None:
        if not _is_small(request):
            # Else the server would read the rest of the body, to find the next request after it.
            return JSONResponse({"error": "too large"}, 413, {"Connection": "close"})
        if not self.limiter.allows(client_of(request), time.monotonic()):
            return JSONResponse({"error": "too fast"}, 429, {"Retry-After": "1"})
        return None


def _is_small(request: Request) -> bool:
    """Whether the request has a small body of a stated length: a chunked one may be of any."""
    length = request.headers.get("content-length", "" if request.method == "POST" else "0")
    if "transfer-encoding" in request.headers or not (length.isascii() and length.isdecimal()):
        return False
    return int(length) <= MAX_BODY


def bounded_protocol(max_connections: int) -> type[H11Protocol]:
    """Return uvicorn's protocol with a limit of connections that no client can use up.

    A connection beyond the limit is accepted, and the oldest of the client with the most is closed:
    idle and half-open ones of a client take the places of its own only. uvicorn's own limit
    refuses every new connection instead.
    """
    connections: dict[str, dict[H11Protocol, None]] = {}

    def forget(client: str, connection: H11Protocol) -> None:
        connections.get(client, {}).pop(connection, None)
        if not connections.get(client, True):
            del connections[client]

    class BoundedProtocol(H11Protocol):
        def connection_made(self, transport: Transport) -> None:  # type: ignore[override]
            super().connection_made(transport)
            connections.setdefault(self._network(), {})[self] = None
            if sum(map(len, connections.values())) > max_connections:
                client, most = max(connections.items(), key=lambda item: len(item[1]))
                oldest = next(iter(most))
                forget(client, oldest)
                oldest.transport.abort()

        def connection_lost(self, exc: Exception | None) -> None:
            super().connection_lost(exc)
            forget(self._network(), self)

        def _network(self) -> str:
            return network_of(self.client[0]) if self.client else ""

    return BoundedProtocol


def max_connections() -> int:
    """Return how many connections the server may hold: the system limits its open files."""
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft == resource.RLIM_INFINITY:
        return MAX_CONNECTIONS
    return max(1, min(MAX_CONNECTIONS, soft - _OTHER_FILES))
